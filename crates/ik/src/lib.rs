//! Markers to joint motion
