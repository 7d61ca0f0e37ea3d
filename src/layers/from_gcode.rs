//! Layers from sliced G-code: the beads of each layer, each swept with its width, united.
