//! This package's units as one shared library: the C functions of FMI 2.0 for its models.
#![deny(missing_docs)]

use adaptive_fmu_models::library::{PACKAGE as OWN, REGISTRY, SOURCE};

adaptive_fmu_framework::define_fmi2_functions!(REGISTRY, SOURCE, OWN);
