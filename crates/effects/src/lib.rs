//! Physical effects that a model may be missing, one file each
