//! Configuration, stage graph, cache and runner: where functions meet files
