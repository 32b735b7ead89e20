//! Model against measurement: residuals by trial, phase, axis, segment
