//! The closed loop of example 3.2.1, as a master runs it.

use adaptive_fmu::exporter::Library;
use adaptive_fmu::structure::{LoopFiles, composite};

use super::{OK, Unit, at_top};

pub const STEP: f64 = 1e-3;

/// The description of one of this package's loops as a single FMU.
pub fn whole(name: &str) -> String {
    let structure = LoopFiles::find(name).unwrap().structure().unwrap();
    composite(&structure, &Library::next_to_program().unwrap()).unwrap().0.text
}

/// The names of this package's loops.
pub fn loop_names() -> Vec<String> {
    let entries = std::fs::read_dir(at_top("examples")).unwrap().map(|entry| entry.unwrap());
    let loops = entries.filter(|entry| entry.path().join("SystemStructure.ssd").is_file());
    let mut names: Vec<_> = loops.map(|entry| entry.file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Reference, plant and controller.
pub struct Loop {
    pub reference: Unit,
    pub plant: Unit,
    pub controller: Unit,
}

impl Loop {
    pub fn new() -> Self {
        let [reference, plant, controller] =
            ["ReferenceNonlinearSiso", "NonlinearSiso", "L1NonlinearSiso"].map(Unit::new);
        Loop { reference, plant, controller }
    }

    pub fn started() -> Self {
        let units = Loop::new();
        units.units().iter().for_each(|unit| unit.start(0.0));
        units
    }

    pub fn units(&self) -> [&Unit; 3] {
        [&self.reference, &self.plant, &self.controller]
    }

    /// The controller's inputs, from what the others give at present.
    pub fn feed_controller(&self) {
        self.controller.put("r[1]", self.reference.get("r[1]"));
        self.controller.put("x[1]", self.plant.get("x[1]"));
        self.controller.put("x[2]", self.plant.get("x[2]"));
    }

    /// Step k, Gauss–Seidel in the order reference, plant, controller.
    pub fn step(&self, k: usize) {
        let t = k as f64 * STEP;
        assert_eq!(self.reference.step(t, STEP), OK, "{:?}", self.reference.messages());
        self.plant.put("u[1]", self.controller.get("u[1]"));
        assert_eq!(self.plant.step(t, STEP), OK, "{:?}", self.plant.messages());
        self.feed_controller();
        assert_eq!(self.controller.step(t, STEP), OK, "{:?}", self.controller.messages());
    }

    pub fn run(&self, steps: std::ops::Range<usize>) {
        steps.for_each(|k| self.step(k));
    }

    pub fn fingerprint(&self) -> [Vec<u8>; 3] {
        self.units().map(Unit::fingerprint)
    }
}
