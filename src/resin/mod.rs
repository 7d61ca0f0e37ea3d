//! Resin jobs: an image a layer, and how long each is exposed.
//!
//! Takes the bytes of an archive, gives a job whose images can be read one at a
//! time. Knows no layer of polygons and no file system.
