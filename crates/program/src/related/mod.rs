//! Related files of FMUs, and reference experiments by which an importer can check itself: those of FMUs of this program are written,
//! those of anybody are read and replayed.
//!
//! Their formats are two young ones of the Modelica Association. This is what was taken from where:
//!
//! - **FMI-LS-REF 1.0.0-beta.1** (modelica/fmi-ls-ref, tag `v1.0.0-beta.1`, commit 70ee1b8 of 1 July 2026): the folder [`FOLDER`], the
//!   manifest's name, its root `fmiReferences` with three attributes of the namespace `NAMESPACE`, `Related` with `type`, `source`,
//!   `role` and `description`, the roles, how a relative `source` is resolved, and that a parameter set applies as it is. Manifests
//!   were checked against `schema/fmi3LayeredStandardReferenceManifest.xsd` of commit 596a89d of 2 July 2026, which differs from that
//!   of the tag in one invalid `xs:import` only. The text still has `1.0.0-alpha.1` for `fmi-ls-version`, which the schema leaves open:
//!   `VERSION` is that of the tag.
//! - **The experiments format** (modelica/ma-hs-experiments), as its page has it and as it was in FMI-LS-REF up to commit a88b22f of
//!   17 June 2026, `schema/fmi3LayeredStandardReferenceExperiments.xsd`, against which files were checked: `Experiments` and
//!   `Experiment` with `name`, `description`, `startTime`, `stopTime`, `tolerance` and `stepSize`; `Parameters`, `Stimuli` and
//!   `References` with `type` and `source`; the media type and the ending `.exp`. A later draft there (commit ff4faf5) has the three
//!   times in an element `TransientSimulation` within `Experiment`; that is read, too.
//!
//! Neither defines `tolerance`. Here it is the largest deviation of an output from its reference, relative to the largest value of
//! that reference. Nor do they define CSV: here it is as FMPy and fmusim read and write it. The first column is `time`, two rows of
//! the same time are a jump, and the elements of an array share one cell, with spaces between them.

mod cases;
mod deviation;
mod files;
mod reading;
mod replay;
mod writing;

pub use deviation::{Deviation, short};
pub use files::{Exported, export, packed};
pub use replay::{Fault, Replay, Replayed};

/// Folder of related files within an FMU.
pub const FOLDER: &str = "extra/org.fmi-standard.fmi-ls-ref";
/// Name of the manifest in it.
pub const MANIFEST: &str = "fmi-ls-manifest.xml";
const NAMESPACE: &str = "http://fmi-standard.org/fmi-ls-manifest";
const NAME: &str = "org.fmi-standard.fmi-ls-ref";
const VERSION: &str = "1.0.0-beta.1";
const DESCRIPTION: &str = "Layered Standard providing information on related files included in an FMU.";
/// Media types.
const EXPERIMENTS: &str = "application/x-ma-hs-experiments";
const PARAMETER_SET: &str = "application/x-ssp-parameter-set";
const TABLE: &str = "text/csv";
/// The role of experiments for a detailed comparison, and that of all experiments.
const VALIDATION: &str = "experiment/validation";
const EXPERIMENT: &str = "experiment";
/// The step of an experiment that names none, as a part of its duration.
const USUAL_STEPS: f64 = 500.0;
