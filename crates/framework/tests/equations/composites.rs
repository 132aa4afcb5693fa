//! A connection of systems is a system: parts, connections, order of evaluation, error coordinates.

use adaptive_fmu::execution::Execution;
use adaptive_fmu::exporter::{self, Library};
use adaptive_fmu::fmi2::model_description;
use adaptive_fmu::framework::structure::Place;
use adaptive_fmu::library::REGISTRY;
use adaptive_fmu::model::{Description, Model};
use adaptive_fmu::structure::{LoopFiles, Structure, composite};
use adaptive_fmu::system::*;
use common::at_top;
use common::loops::whole as composite_text;
use common::models::Run;

/// x' = k (u − x), y = x + d u: feedthrough where d isn't 0.
struct Lag {
    k: ScalarOf<Parameter>,
    d: ScalarOf<Parameter>,
    u: VectorOf<Input>,
    x: VectorOf<State>,
    y: VectorOf<Signal>,
    /// −x, without feedthrough.
    z: VectorOf<Signal>,
}

impl System for Lag {
    type Structure = NoStructure;
    const NAME: &'static str = "lag";
    const DOCUMENTATION: &'static str = "A lag.";
    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Lag {
            k: d.parameter(scalar("k", "rate").start(1.0).unit("1/s")),
            d: d.parameter(scalar("d", "feedthrough")),
            u: d.input(vector("u", 2, "inputs, added").start(0.0).unit("m")),
            x: d.state(vector("x", 1, "state").output().unit("m")),
            y: d.output(vector("y", 1, "output").unit("m")),
            z: d.output(vector("z", 1, "the state, turned round").unit("m")),
        })
    }
    fn prepare(&self, v: &mut Point) -> Result<(), Invalid> {
        if v[self.d] > 10.0 { Err(Invalid::new(v.name(self.d), v[self.d], "must be at most 10")) } else { Ok(()) }
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        let [u1, u2] = v.array(self.u);
        let [x] = v.array(self.x);
        y.set(self.y, [x + v[self.d] * (u1 + u2)]);
        y.set(self.z, [-x]);
    }
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [u1, u2] = v.array(self.u);
        let [x] = v.array(self.x);
        dx.set(self.x, [v[self.k] * (u1 + u2 - x)]);
    }
}

/// x' = −x + sin t + u, from x0.
struct Plant {
    x0: VectorOf<Parameter>,
    u: VectorOf<Input>,
    x: VectorOf<State>,
}

impl System for Plant {
    type Structure = NoStructure;
    const NAME: &'static str = "plant";
    const DOCUMENTATION: &'static str = "A plant.";
    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        Ok(Plant {
            x0: d.parameter(vector("x0", 1, "initial state").start(0.0).fixed()),
            u: d.input(vector("u", 1, "control").start(0.0).unit("N")),
            x: d.state(vector("x", 1, "state").output()),
        })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x0, self.x);
    }
    fn outputs<S: Scalar>(&self, _t: S, _v: &Values<S>, _y: &mut Signals<S>) {}
    fn derivatives<S: Scalar>(&self, t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let ([x], [u]) = (v.array(self.x), v.array(self.u));
        dx.set(self.x, [-x + t.sin() + u]);
    }
}

/// x_m' = −x_m + 1, u = −gain e with e = x − x_m: so e stays near (sin t − 1)/gain.
struct ModelReference {
    gain: ScalarOf<Parameter>,
    x: VectorOf<Input>,
    x_m: VectorOf<State>,
    u: VectorOf<Signal>,
    error: DifferenceOf,
}

impl System for ModelReference {
    type Structure = NoStructure;
    const NAME: &'static str = "model-reference";
    const DOCUMENTATION: &'static str = "A controller.";
    fn declare(_: NoStructure, d: &mut Declaration) -> Result<Self, Invalid> {
        let x = d.input(vector("x", 1, "measured state").start(0.0));
        let x_m = d.state(vector("x_m", 1, "state of the model"));
        let error = d.difference(x, x_m, 1e-9);
        let u = d.output(vector("u", 1, "control"));
        Ok(ModelReference { gain: d.parameter(scalar("gain", "gain").start(1e12)), x, x_m, u, error })
    }
    fn initialise<S: Scalar>(&self, _t: S, v: &mut Point<S>) {
        v.copy(self.x, self.x_m);
    }
    fn outputs<S: Scalar>(&self, _t: S, v: &Values<S>, y: &mut Signals<S>) {
        y.set(self.u, [-v[self.gain] * v.difference(self.error, 0)]);
    }
    fn derivatives<S: Scalar>(&self, _t: S, v: &Values<S>, dx: &mut Rates<S>) {
        let [x_m] = v.array(self.x_m);
        dx.set(self.x_m, [-x_m + 1.0]);
    }
}

static SYSTEMS: Registry = &[Kind::of::<Lag>(), Kind::of::<Plant>(), Kind::of::<ModelReference>(), Kind::COMPOSITE];

fn build(structure: &str, registry: Registry) -> Result<Model, Invalid> {
    let text = format!("name = \"Whole\"\nmodel = \"composite\"\ndescription = \"\"\n[structure]\n{structure}");
    Model::from_description(Description::read(&text)?, registry)
}

fn whole(structure: &str) -> Run {
    let mut execution = Execution::new(build(structure, SYSTEMS).unwrap());
    execution.initialise().unwrap();
    Run(execution)
}

fn refusal(structure: &str) -> String {
    build(structure, SYSTEMS).unwrap_err().to_string()
}

const TWO_LAGS: &str = r#"
connections = [["a.y[1]", "b.u[1]"], ["b.z[1]", "a.u[1]"]]
parts = [{ name = "a", model = "lag", start = { d = 0.5 } }, { name = "b", model = "lag", start = { k = 3.0 } }]
"#;

#[test]
fn a_feedback_connection_is_the_system_of_its_equations() {
    // a' = (−b + w) − a, b' = 3 (a + 0.5 (−b + w) − b), with w the open input of a: w = 1 settles at a = 0.4, b = 0.6.
    let mut run = whole(TWO_LAGS);
    run.set("a.u[2]", 1.0);
    run.run(300, 0.1);
    assert!((run.get("a.x[1]") - 0.4).abs() < 1e-6 && (run.get("b.x[1]") - 0.6).abs() < 1e-6);
    let (a, b) = (run.get("a.x[1]"), run.get("b.x[1]"));
    assert!((run.get("der(a.x[1])") - (-b + 1.0 - a)).abs() < 1e-12);
    assert!((run.get("der(b.x[1])") - 3.0 * (a + 0.5 * (1.0 - b) - b)).abs() < 1e-12);
    assert_eq!(run.get("b.u[1]"), run.get("a.y[1]"));
}

#[test]
fn its_ports_are_what_is_open_and_every_output() {
    let model = build(TWO_LAGS, SYSTEMS).unwrap();
    let of = |causality| -> Vec<String> {
        model.variables().visible().filter(|e| e.variable.causality == causality).map(|e| e.name()).collect()
    };
    let mut inputs = of(Causality::Input);
    inputs.sort();
    assert_eq!(inputs, ["a.u[2]", "b.u[2]"]);
    assert_eq!(of(Causality::Output), ["a.x[1]", "a.y[1]", "a.z[1]", "b.x[1]", "b.y[1]", "b.z[1]"]);
    assert!(model_description::xml(&model).contains("name=\"a.k\""));
}

#[test]
fn exact_derivatives_go_through_the_connections() {
    let mut run = whole(TWO_LAGS);
    let variables = run.0.model().variables();
    let index = |name: &str| variables.index(variables.find(name).unwrap()) as u32;
    let (unknowns, knowns) = ([index("der(b.x[1])"), index("b.y[1]")], [index("a.u[2]")]);
    let derivatives = run.0.directional_derivative(&knowns, &[1.0]);
    assert_eq!(unknowns.map(|unknown| derivatives[unknown as usize]), [1.5, 0.0], "3 × 0.5 through a's feedthrough");
}

#[test]
fn a_wrong_connection_is_refused_by_its_names() {
    let parts =
        r#"parts = [{ name = "a", model = "lag" }, { name = "b", model = "lag" }, { name = "p", model = "plant" }]"#;
    let with = |connections: &str| refusal(&format!("connections = {connections}\n{parts}"));
    assert!(with(r#"[["a.nothing", "p.u[1]"]]"#).contains("a.nothing -> p.u[1]: there is no `a.nothing`"));
    assert!(with(r#"[["a.k", "p.u[1]"]]"#).contains("`a.k` is not a real output"));
    assert!(with(r#"[["a.y[1]", "p.x[1]"]]"#).contains("`p.x[1]` is not a real input"));
    assert!(with(r#"[["a.y[1]", "p.u[1]"]]"#).contains("a.y[1] -> p.u[1]: units don't fit, m against N"));
    let doubled = with(r#"[["a.y[1]", "b.u[1]"], ["a.z[1]", "b.u[1]"]]"#);
    assert!(doubled.contains("`b.u[1]` is connected already, by a.y[1] -> b.u[1]"), "{doubled}");
}

#[test]
fn an_algebraic_loop_is_refused_by_its_connections() {
    let text = refusal(
        r#"
        connections = [["a.y[1]", "b.u[1]"], ["b.y[1]", "a.u[1]"]]
        parts = [{ name = "a", model = "lag" }, { name = "b", model = "lag" }]
        "#,
    );
    assert!(text.contains("algebraic loop through a.y[1] -> b.u[1], b.y[1] -> a.u[1]"), "{text}");
}

#[test]
fn a_part_that_refuses_is_named() {
    let part = |rest: &str| refusal(&format!("parts = [{{ name = \"a\", {rest} }}]"));
    assert!(part(r#"model = "lag", start = { d = 11.0 }"#).contains("a.d = 11: must be at most 10"));
    assert!(part(r#"model = "lag", start = { q = 11.0 }"#).contains("[start] a.q"));
    assert!(part(r#"model = "nothing""#).contains("there is no such kind; there are: lag"));
    assert!(part(r#"model = "composite""#).contains("a part can't be a composite"));
    assert!(refusal(r#"parts = [{ name = "a", model = "lag" }, { name = "a", model = "lag" }]"#).contains("two parts"));
    assert!(refusal(r#"parts = [{ name = "a.b", model = "lag" }]"#).contains("must be letters"));
}

const IN_ERRORS: &str = r#"
connections = [["plant.x[1]", "controller.x[1]"], ["controller.u[1]", "plant.u[1]"]]
parts = [{ name = "plant", model = "plant", start = { "x0[1]" = 0.25 } }, { name = "controller", model = "model-reference" }]
"#;

#[test]
fn a_tiny_difference_keeps_its_digits() {
    let mut run = whole(IN_ERRORS);
    assert_eq!((run.get("plant.x[1]"), run.get("plant.x_error[1]")), (0.25, 0.0));
    run.run(5, 1e-11);
    let t = run.0.time();
    // e' = sin t − 1 − (gain + 1) e: past the transient of 1e-12 s, e = (sin t − 1) / (gain + 1).
    let settled = (t.sin() - 1.0) / 1e12;
    // The relative tolerance of 1e-6, of the nominal 1e-9 that the controller declares.
    assert!((run.get("plant.x_error[1]") - settled).abs() < 1e-15, "{}", run.get("plant.x_error[1]"));
    assert_eq!(run.get("plant.x[1]"), run.get("plant.x_error[1]") + run.get("controller.x_m[1]"));
}

#[test]
fn a_composite_of_this_package_starts_and_depends_as_declared() {
    for (name, _) in exporter::loops() {
        let model = Model::from_description(Description::read(&composite_text(name)).unwrap(), REGISTRY).unwrap();
        let variables = model.variables();
        assert!(variables.find("controller.u[1]").is_some());
        // u_ad is what its filter holds, unless it is the state of that itself; other laws have estimates in the control.
        let names = ["filter_state[", "u_ad[", "theta_hat[", "theta_f["].map(|name| format!("controller.{name}"));
        let is_constant =
            |e: &Element| e.variable.section == Section::State && names.iter().any(|name| e.name().starts_with(name));
        let constant: Vec<Place> = variables.visible().filter(is_constant).map(|e| Place::of(variables, e)).collect();
        let dependence = model.structure();
        let moves = |rate: Element| {
            let on = dependence.running(Place::of(variables, rate));
            rate.name().starts_with("der(plant.") && constant.iter().any(|constant| on.contains(constant))
        };
        let mut rates = variables.visible().filter(|element| element.variable.section == Section::Derivative);
        assert!(rates.any(moves), "{name}: a derivative of the plant depends on the control's state");
        drop(rates);
        let mut execution = Execution::new(model);
        execution.initialise().unwrap();
        execution.step(0.0, 1e-3).unwrap();
    }
}

/// The cosine loop with some text of its file in place of another.
fn changed(old: &str, new: &str) -> Structure {
    let folder = tempfile::tempdir().unwrap();
    let example = at_top("examples/3.2.1-cosine");
    std::fs::copy(example.join("reference.ssv"), folder.path().join("reference.ssv")).unwrap();
    let text = std::fs::read_to_string(example.join("SystemStructure.ssd")).unwrap();
    assert!(text.contains(old), "{old}");
    std::fs::write(folder.path().join("SystemStructure.ssd"), text.replacen(old, new, 1)).unwrap();
    LoopFiles::find(folder.path().to_str().unwrap()).unwrap().structure().unwrap()
}

#[test]
fn a_loop_as_a_composite_is_checked_as_one_of_separate_units() {
    let library = Library::next_to_program().unwrap();
    let to_plant = r#"startConnector="u[1]" endElement="plant" endConnector="u[1]"/>"#;
    let scaled = to_plant.replace("/>", r#"><ssc:LinearTransformation factor="2"/></ssd:Connection>"#);
    let cases = [
        (r#"startElement="plant" startConnector="x[1]""#, r#"startElement="pump" startConnector="x[1]""#, "`pump`"),
        (r#"startElement="plant" startConnector="x[1]""#, r#"startElement="plant" startConnector="v[1]""#, "`v[1]`"),
        (r#"endElement="controller" endConnector="x[1]""#, r#"endElement="controller" endConnector="r[1]""#, "already"),
        (r#"endElement="controller" endConnector="x[1]""#, r#"endElement="plant" endConnector="y[1]""#, "output"),
        (
            r#"startElement="plant" startConnector="x[1]""#,
            r#"startElement="plant" startConnector="x[2]""#,
            "another dimension",
        ),
        (to_plant, &scaled, "can't convert values"),
    ];
    for (old, new, word) in cases {
        let error = composite(&changed(old, new), &library).unwrap_err().to_string();
        assert!(error.contains(word) && error.contains("SystemStructure.ssd: line "), "{error}");
    }
    let foreign = changed("resources/NonlinearSiso.fmu", "resources/Pump.fmu");
    let error = composite(&foreign, &library).unwrap_err().to_string();
    assert!(error.contains("`Pump`") && error.contains("`adaptive-fmu list` shows all"), "{error}");
}

#[test]
fn start_values_of_a_loop_hold_in_the_composite_and_what_it_leaves_out_is_reported() {
    let library = Library::next_to_program().unwrap();
    let mut structure = changed("", "");
    // An enumeration by the number of its item, as FMI's functions take it.
    for value in ["reference.signal=2", "plant.x0[1]=0.25", "controller.relative_tolerance=1e-9"] {
        structure.set(value).unwrap();
    }
    let (source, notes) = composite(&structure, &library).unwrap();
    let mut execution =
        Execution::new(Model::from_description(Description::read(&source.text).unwrap(), REGISTRY).unwrap());
    execution.initialise().unwrap();
    let run = Run(execution);
    assert_eq!((run.get("plant.x[1]"), run.get("reference.r[1]")), (0.25, 1.0));
    assert!(notes.len() == 1 && notes[0].contains("`controller.relative_tolerance` is ignored"), "{notes:?}");
    structure.set("reference.signal=3").unwrap();
    let error = composite(&structure, &library).unwrap_err().to_string();
    assert!(error.contains("`reference.signal` = 3") && error.contains("cosine (1), square (2)"), "{error}");
}

#[test]
fn an_input_that_nothing_is_connected_to_is_reported_and_stays_one() {
    let connection =
        r#"<ssd:Connection startElement="controller" startConnector="u[1]" endElement="plant" endConnector="u[1]"/>"#;
    let (source, notes) = composite(&changed(connection, ""), &Library::next_to_program().unwrap()).unwrap();
    assert!(notes.len() == 1 && notes[0].contains("`plant.u[1]` is not connected"), "{notes:?}");
    let model = Model::from_description(Description::read(&source.text).unwrap(), REGISTRY).unwrap();
    assert_eq!(model.variables().find("plant.u[1]").unwrap().variable.causality, Causality::Input);
}
