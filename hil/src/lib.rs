//! The rig: scenarios as data, run on a virtual clock against the mock printer, over
//! pseudo-terminals against the real binary, and on a real printer's port.
