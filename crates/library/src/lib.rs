//! This package's models as one shared library: the C functions of FMI 2.0 and FMI 3.0. What describes and exports them is in the
//! program only, so that FMUs are small.
#![deny(missing_docs)]

use adaptive_fmu_models::library::{IN_FMU, PACKAGE as OWN, SOURCE};

adaptive_fmu_framework::define_fmi2_functions!(IN_FMU, SOURCE, OWN);
