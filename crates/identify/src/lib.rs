//! Base parameters, their scale and uncertainty, and consistent links
