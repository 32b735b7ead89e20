//! Files that other programs open, one file a format
