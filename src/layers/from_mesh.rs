//! Layers from a mesh: every triangle against every plane, by a sweep.
