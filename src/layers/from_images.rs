//! Layers from the images of a resin job: contours at half brightness.
