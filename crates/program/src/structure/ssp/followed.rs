//! Signals that follow references, as a loop's metrics or else its connections show.

use super::{Connection, Connector, Structure};

/// Tests whether a signal follows a reference, the strongest first.
const REASONS: [fn(&Pair) -> bool; 4] = [
    |pair| pair.is_output_of_same_index(),
    |pair| pair.names_it(),
    |pair| parts(pair.signal).1.is_some() && pair.has_same_index(),
    |pair| pair.stands_in_same_place(),
];

/// A reference and a signal that its controller measures, or that the measured plant shows.
struct Pair<'a> {
    /// Names of the reference's output and of the input that takes it.
    reference: [&'a str; 2],
    /// Name of the signal.
    signal: &'a str,
    /// True if the controller takes it.
    is_measured: bool,
    /// Places among the references and among the measured signals, if there are as many of both.
    places: Option<[usize; 2]>,
}

/// A name without an index, and that.
fn parts(name: &str) -> (&str, Option<&str>) {
    name.strip_suffix(']').and_then(|name| name.split_once('[')).map_or((name, None), |(base, k)| (base, Some(k)))
}

impl Pair<'_> {
    /// True for the tracked output of the same index: `y[1]` for `r[1]`.
    fn is_output_of_same_index(&self) -> bool {
        parts(self.signal).0 == "y" && self.has_same_index()
    }

    /// True if the reference names the signal, as `speed_reference` names `speed`.
    fn names_it(&self) -> bool {
        let (base, _) = parts(self.signal);
        base.len() > 1 && self.reference.iter().any(|name| name.contains(base)) && self.has_same_index()
    }

    fn has_same_index(&self) -> bool {
        self.reference.iter().any(|name| parts(name).1 == parts(self.signal).1)
    }

    fn stands_in_same_place(&self) -> bool {
        self.is_measured && self.places.is_some_and(|[of_reference, of_signal]| of_reference == of_signal)
    }
}

/// A signal that follows a reference.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tracked {
    /// Its name in the loop.
    pub signal: String,
    /// The reference's name in the loop.
    pub reference: String,
    /// The component that takes the reference and a signal that isn't one; empty if none does.
    pub controller: String,
    /// Its outputs that others take, by their names in the loop.
    pub controls: Vec<String>,
}

impl Structure {
    /// Signals with their references: those whose difference is a metric, else those that connections show.
    pub fn tracked(&self) -> Vec<Tracked> {
        let sources: Vec<&str> = self.sources().collect();
        let mut pairs: Vec<[(String, String); 2]> = Vec::new();
        for metric in &self.metrics {
            let ends = metric.minus.as_ref().and_then(|minus| Some([self.ends_of(minus)?, self.ends_of(&metric.of)?]));
            let pair = ends.filter(|[reference, _]| sources.contains(&reference.0.as_str()));
            pairs.extend(pair.filter(|pair| !pairs.contains(pair)));
        }
        if pairs.is_empty() {
            pairs = self.followed();
        }
        let name = |(unit, variable): &(String, String)| format!("{unit}.{variable}");
        let tracked = |[reference, signal]: [(String, String); 2]| {
            let measures = |unit: &str| {
                let mut into = self.connections.iter().filter(|connection| connection.to.0 == unit);
                into.any(|connection| !sources.contains(&connection.from.0.as_str()))
            };
            let takers = self.connections.iter().filter(|connection| connection.from == reference);
            let mut takers = takers.map(|connection| &connection.to.0);
            let controller = takers.find(|unit| measures(unit)).cloned().unwrap_or_default();
            let is_control =
                |connection: &&Connection| connection.from.0 == controller && connection.to.0 != controller;
            let mut controls: Vec<String> = Vec::new();
            for connection in self.connections.iter().filter(is_control) {
                let control = name(&connection.from);
                controls.extend(Some(control).filter(|control| !controls.contains(control)));
            }
            Tracked { signal: name(&signal), reference: name(&reference), controller, controls }
        };
        pairs.into_iter().map(tracked).collect()
    }

    /// Component and variable of a name in the loop.
    fn ends_of(&self, name: &str) -> Option<(String, String)> {
        self.components.iter().find_map(|component| {
            let variable = name.strip_prefix(&component.name)?.strip_prefix('.')?;
            Some((component.name.clone(), variable.to_owned()))
        })
    }

    /// Components whose outputs don't depend on the loop.
    pub fn sources(&self) -> impl Iterator<Item = &str> {
        let takes = |kind: &str| kind == "input" || kind == "inout";
        let alone = |name: &str| self.connections.iter().all(|connection| connection.to.0 != name);
        let gives = |name: &str| self.connections.iter().any(|connection| connection.from.0 == name);
        let units = self.components.iter();
        let sources = units.filter(move |unit| !unit.connectors.iter().any(|connector| takes(&connector.kind)));
        sources.map(|unit| unit.name.as_str()).filter(move |name| alone(name) && gives(name))
    }

    /// References with the signals that follow them, each as component and variable. A component that takes a reference
    /// and something else is its controller; the follower is the tracked output of the plant that it measures, or a
    /// measured signal, by name, index, or place.
    pub(super) fn followed(&self) -> Vec<[(String, String); 2]> {
        let sources: Vec<&str> = self.sources().collect();
        let mut found: Vec<[(String, String); 2]> = Vec::new();
        for controller in &self.components {
            let into =
                |connection: &&Connection| connection.to.0 == controller.name && connection.from.0 != controller.name;
            let (references, measured): (Vec<&Connection>, Vec<&Connection>) =
                self.connections.iter().filter(into).partition(|connection| sources.contains(&&*connection.from.0));
            let is_rate =
                |name: &str| references.iter().any(|other| name.strip_prefix('d') == Some(other.to.1.as_str()));
            let references: Vec<_> = references.iter().filter(|reference| !is_rate(&reference.to.1)).collect();
            for (place, reference) in references.iter().enumerate() {
                let is_free = |signal: &(String, String)| found.iter().all(|[_, taken]| taken != signal);
                let count = (references.len() == measured.len()).then_some(place);
                let signal = self.follower(reference, count, &measured).filter(is_free);
                found.extend(signal.map(|signal| [reference.from.clone(), signal]));
            }
        }
        found
    }

    /// The signal that follows a reference.
    fn follower(
        &self,
        reference: &Connection,
        place: Option<usize>,
        measured: &[&Connection],
    ) -> Option<(String, String)> {
        let plant = measured.first()?.from.0.clone();
        let shown = self.outputs(&plant).filter(|output| measured.iter().all(|other| other.from.1 != output.name));
        let shown = shown.map(|output| (usize::MAX, (plant.clone(), output.name.clone())));
        let candidates = measured.iter().map(|connection| connection.from.clone()).enumerate().chain(shown);
        let unit = self.unit_of_connector(&reference.from);
        let fits = |signal: &(String, String)| {
            unit.is_none() || self.unit_of_connector(signal).is_none_or(|other| Some(other) == unit)
        };
        let candidates: Vec<_> = candidates.filter(|(_, signal)| fits(signal)).collect();
        REASONS.into_iter().find_map(|reason| {
            let holds = |(k, signal): &&(usize, (String, String))| {
                reason(&Pair {
                    reference: [&reference.from.1, &reference.to.1],
                    signal: &signal.1,
                    is_measured: *k < usize::MAX,
                    places: place.map(|place| [place, *k]),
                })
            };
            candidates.iter().find(holds).map(|(_, signal)| signal.clone())
        })
    }

    fn outputs(&self, unit: &str) -> impl Iterator<Item = &Connector> {
        let unit = self.components.iter().find(|component| component.name == unit);
        unit.into_iter().flat_map(|unit| &unit.connectors).filter(|connector| connector.kind == "output")
    }

    /// The unit of measurement of an output, if the structure has it.
    fn unit_of_connector(&self, (unit, name): &(String, String)) -> Option<&str> {
        let connector = self.outputs(unit).find(|connector| connector.name == *name)?;
        connector.unit.as_ref().map(|unit| unit.name.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{LoopFiles, Plot, STRUCTURE};

    const UNITS: &str =
        "<Units><Unit name='rad'><BaseUnit rad='1'/></Unit><Unit name='A'><BaseUnit A='1'/></Unit></Units>";

    /// The plots that a structure without any gets.
    fn plots(text: &str) -> Vec<Plot> {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(STRUCTURE), text).unwrap();
        LoopFiles::within(folder.path()).structure().unwrap().plots
    }

    fn titled(text: &str) -> Vec<(String, String)> {
        plots(text).into_iter().map(|plot| (plot.title, plot.signals.join(" "))).collect()
    }

    /// A loop of a setpoint, a controller and a plant: outputs of the setpoint, outputs of the plant with their units,
    /// and inputs of the controller for both.
    fn of(setpoints: &[&str], outputs: &[(&str, &str)], inputs: &[&str]) -> String {
        let connector = |name: &str, kind: &str, unit: &str| {
            let unit = if unit.is_empty() { String::new() } else { format!(" unit='{unit}'") };
            format!("<Connector name='{name}' kind='{kind}'><c:Real{unit}/></Connector>")
        };
        let component = |name: &str, connectors: String| {
            let kind = "type='application/x-fmu-sharedlibrary'";
            format!(
                "<Component name='{name}' {kind} source='resources/{name}.fmu'><Connectors>{connectors}</Connectors></Component>"
            )
        };
        let link = |[from, output, to, input]: [&str; 4]| {
            format!(
                "<Connection startElement='{from}' startConnector='{output}' endElement='{to}' endConnector='{input}'/>"
            )
        };
        let given = setpoints.iter().map(|name| connector(name, "output", "rad")).collect();
        let shown: String = outputs.iter().map(|(name, unit)| connector(name, "output", unit)).collect();
        let taken: String = inputs.iter().map(|name| connector(name, "input", "")).collect();
        let sources =
            setpoints.iter().map(|name| ["setpoint", name]).chain(outputs.iter().map(|(name, _)| ["plant", name]));
        let links: String =
            sources.zip(inputs).map(|([from, output], input)| link([from, output, "law", input])).collect();
        let elements = [
            component("setpoint", given),
            component("law", taken + &connector("force", "output", "")),
            component("plant", connector("force", "input", "") + &shown),
        ];
        format!(
            "<SystemStructureDescription xmlns='http://ssp-standard.org/SSP1/SystemStructureDescription' \
             xmlns:c='http://ssp-standard.org/SSP1/SystemStructureCommon' name='it' version='1.0'><System name='s'>\
             <Elements>{}</Elements><Connections>{links}{}</Connections></System>{UNITS}</SystemStructureDescription>",
            elements.concat(),
            link(["law", "force", "plant", "force"])
        )
    }

    #[test]
    fn a_reference_is_drawn_with_the_signal_of_its_name_and_the_rest_by_itself() {
        let text = of(&["angle_wanted"], &[("current", "A"), ("angle", "rad")], &["angle_wanted", "i", "angle"]);
        let rest = [("law", "law.force"), ("plant", "plant.current")].map(|(a, b)| (a.to_owned(), b.to_owned()));
        let first = ("plant and setpoint".to_owned(), "plant.angle setpoint.angle_wanted".to_owned());
        assert_eq!(titled(&text), [&[first], &rest[..]].concat());
    }

    #[test]
    fn a_reference_is_drawn_with_the_output_of_its_index_and_rates_by_themselves() {
        let text = of(
            &["r[1]", "dr[1]", "r[2]"],
            &[("x[1]", ""), ("x[2]", ""), ("y[1]", ""), ("y[2]", "")],
            &["r[1]", "dr[1]", "r[2]", "x[1]", "x[2]"],
        );
        let titles = titled(&text);
        assert_eq!(titles[0].1, "plant.y[1] setpoint.r[1] plant.y[2] setpoint.r[2]", "shown, though nothing takes it");
        assert_eq!(titles[1], ("setpoint".to_owned(), "setpoint.dr[1]".to_owned()));
    }

    #[test]
    fn the_controller_of_a_reference_measures_something() {
        let text = of(&["r"], &[("y", "")], &["r", "y"]);
        // Another component takes the reference, before the controller does.
        let recorder = "<Component name='recorder' type='application/x-fmu-sharedlibrary' source='resources/recorder.fmu'>\
                        <Connectors><Connector name='r' kind='input'><c:Real/></Connector></Connectors></Component>";
        let link = "<Connection startElement='setpoint' startConnector='r' endElement='recorder' endConnector='r'/>";
        let text = text.replacen("<Elements>", &format!("<Elements>{recorder}"), 1);
        let text = text.replacen("<Connections>", &format!("<Connections>{link}"), 1);
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(STRUCTURE), text).unwrap();
        let tracked = LoopFiles::within(folder.path()).structure().unwrap().tracked();
        let [one] = &tracked[..] else { panic!("{tracked:?}") };
        assert_eq!([&one.signal, &one.reference, &one.controller], ["plant.y", "setpoint.r", "law"]);
        assert_eq!(one.controls, ["law.force"]);
    }

    #[test]
    fn one_reference_is_drawn_with_the_one_signal_that_is_measured() {
        assert_eq!(titled(&of(&["w"], &[("p", "rad")], &["w", "p"]))[0].1, "plant.p setpoint.w");
    }

    #[test]
    fn nothing_is_guessed_without_a_hint_and_no_current_follows_an_angle() {
        for (setpoint, outputs) in
            [("w", [("p", "rad"), ("v", "rad")]), ("current_wanted", [("current", "A"), ("v", "A")])]
        {
            let titles = titled(&of(&[setpoint], &outputs, &["w", "a", "b"]));
            assert_eq!(
                titles.iter().map(|(title, _)| title.as_str()).collect::<Vec<_>>(),
                ["setpoint", "law", "plant"]
            );
        }
    }
}
