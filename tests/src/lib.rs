//! End-to-end stories; see the files beside this one.
