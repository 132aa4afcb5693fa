//! `info` of a loop: its components and connections.

use adaptive_fmu::error::{Error, one_line};
use adaptive_fmu::report::number;
use adaptive_fmu::structure::{Connection, LoopFiles, Structure};
use serde_json::{Value, json};

/// Prints what a loop consists of.
pub fn execute(name: &str, as_json: bool) -> Result<(), Error> {
    let structure = LoopFiles::find(name)?.structure()?;
    if as_json {
        print_line!("{}", in_json(&structure));
    } else {
        print(&structure);
    }
    Ok(())
}

fn joined((component, variable): &(String, String)) -> String {
    format!("{component}.{variable}")
}

fn in_json(structure: &Structure) -> Value {
    let Structure { name, description, components, connections, start_time, stop_time, step, order, .. } = structure;
    let components: Vec<_> =
        components.iter().map(|component| json!({ "name": component.name, "source": component.source })).collect();
    let connection =
        |connection: &Connection| json!({ "from": joined(&connection.from), "to": joined(&connection.to) });
    json!({ "name": name, "description": description, "components": components,
            "connections": connections.iter().map(connection).collect::<Vec<_>>(),
            "start_time": start_time, "stop_time": stop_time, "step": step, "order": order.to_string() })
}

fn print(structure: &Structure) {
    // What others wrote may hold line ends and control characters.
    let line = |text: String| print_line!("{}", one_line(&text));
    let Structure { name, description, components, connections, stop_time, step, order, .. } = structure;
    line(if description.is_empty() { name.clone() } else { format!("{name}: {description}") });
    let [until, step] = [*stop_time, *step].map(number);
    line(format!("until {until} s, communication step {step} s, {order}"));
    print_line!();
    print_line!("{:24} FMU", "component");
    components.iter().for_each(|component| line(format!("{:24} {}", component.name, component.source)));
    print_line!();
    print_line!("{:32} to", "connection from");
    connections.iter().for_each(|each| line(format!("{:32} {}", joined(&each.from), joined(&each.to))));
}
