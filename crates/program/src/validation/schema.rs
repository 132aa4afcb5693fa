//! The elements of a modelDescription.xml: their children, in order, and their attributes.

use roxmltree::Node;

use super::findings::{Findings, Lines};
use super::text::Type::{self, Any, Boolean, DateTime, Double, Indices, Int, Kinds, OneOf, Unsigned};

struct Element {
    name: &'static str,
    /// The section of the standard that defines it.
    section: &'static str,
    attributes: &'static [Attribute],
    /// Its children, in order; none if it may have any.
    holds: Option<&'static [Part]>,
}

struct Attribute {
    name: &'static str,
    kind: Type,
    required: bool,
}

/// Some elements, one of which occurs so many times.
struct Part {
    elements: &'static [&'static Element],
    least: usize,
    most: usize,
}

const fn may(name: &'static str, kind: Type) -> Attribute {
    Attribute { name, kind, required: false }
}

const fn must(name: &'static str, kind: Type) -> Attribute {
    Attribute { name, kind, required: true }
}

const fn element(name: &'static str, section: &'static str, attributes: &'static [Attribute]) -> Element {
    Element { name, section, attributes, holds: Some(&[]) }
}

const fn optional(elements: &'static [&'static Element]) -> Part {
    Part { elements, least: 0, most: 1 }
}

const fn one(elements: &'static [&'static Element]) -> Part {
    Part { elements, least: 1, most: 1 }
}

const fn many(elements: &'static [&'static Element]) -> Part {
    Part { elements, least: 1, most: usize::MAX }
}

const FILE: Element = element("File", "2.2.1", &[must("name", Any)]);
const SOURCE_FILES: Element = Element { holds: Some(&[many(&[&FILE])]), ..element("SourceFiles", "2.2.1", &[]) };
const MODEL_EXCHANGE: Element = Element {
    holds: Some(&[optional(&[&SOURCE_FILES])]),
    ..element(
        "ModelExchange",
        "3.3.1",
        &[
            must("modelIdentifier", Any),
            may("needsExecutionTool", Boolean),
            may("completedIntegratorStepNotNeeded", Boolean),
            may("canBeInstantiatedOnlyOncePerProcess", Boolean),
            may("canNotUseMemoryManagementFunctions", Boolean),
            may("canGetAndSetFMUstate", Boolean),
            may("canSerializeFMUstate", Boolean),
            may("providesDirectionalDerivative", Boolean),
        ],
    )
};
const CO_SIMULATION: Element = Element {
    holds: Some(&[optional(&[&SOURCE_FILES])]),
    ..element(
        "CoSimulation",
        "4.3.1",
        &[
            must("modelIdentifier", Any),
            may("needsExecutionTool", Boolean),
            may("canHandleVariableCommunicationStepSize", Boolean),
            may("canInterpolateInputs", Boolean),
            may("maxOutputDerivativeOrder", Unsigned),
            // The standard itself writes it so.
            may("canRunAsynchronuously", Boolean),
            may("canBeInstantiatedOnlyOncePerProcess", Boolean),
            may("canNotUseMemoryManagementFunctions", Boolean),
            may("canGetAndSetFMUstate", Boolean),
            may("canSerializeFMUstate", Boolean),
            may("providesDirectionalDerivative", Boolean),
        ],
    )
};
const BASE_UNIT: Element = element(
    "BaseUnit",
    "2.2.2",
    &[
        may("kg", Int),
        may("m", Int),
        may("s", Int),
        may("A", Int),
        may("K", Int),
        may("mol", Int),
        may("cd", Int),
        may("rad", Int),
        may("factor", Double),
        may("offset", Double),
    ],
);
const DISPLAY_UNIT: Element =
    element("DisplayUnit", "2.2.2", &[must("name", Any), may("factor", Double), may("offset", Double)]);
const UNIT: Element = Element {
    holds: Some(&[optional(&[&BASE_UNIT]), Part { least: 0, ..many(&[&DISPLAY_UNIT]) }]),
    ..element("Unit", "2.2.2", &[must("name", Any)])
};
const UNIT_DEFINITIONS: Element =
    Element { holds: Some(&[many(&[&UNIT])]), ..element("UnitDefinitions", "2.2.2", &[]) };
const REAL_TYPE: Element = element(
    "Real",
    "2.2.3",
    &[
        may("quantity", Any),
        may("unit", Any),
        may("displayUnit", Any),
        may("relativeQuantity", Boolean),
        may("min", Double),
        may("max", Double),
        may("nominal", Double),
        may("unbounded", Boolean),
    ],
);
const INTEGER_TYPE: Element = element("Integer", "2.2.3", &[may("quantity", Any), may("min", Int), may("max", Int)]);
const ITEM: Element = element("Item", "2.2.3", &[must("name", Any), must("value", Int), may("description", Any)]);
const ENUMERATION_TYPE: Element =
    Element { holds: Some(&[many(&[&ITEM])]), ..element("Enumeration", "2.2.3", &[may("quantity", Any)]) };
const SIMPLE_TYPE: Element = Element {
    holds: Some(&[one(&[
        &REAL_TYPE,
        &INTEGER_TYPE,
        &element("Boolean", "2.2.3", &[]),
        &element("String", "2.2.3", &[]),
        &ENUMERATION_TYPE,
    ])]),
    ..element("SimpleType", "2.2.3", &[must("name", Any), may("description", Any)])
};
const TYPE_DEFINITIONS: Element =
    Element { holds: Some(&[many(&[&SIMPLE_TYPE])]), ..element("TypeDefinitions", "2.2.3", &[]) };
const CATEGORY: Element = element("Category", "2.2.4", &[must("name", Any), may("description", Any)]);
const LOG_CATEGORIES: Element =
    Element { holds: Some(&[many(&[&CATEGORY])]), ..element("LogCategories", "2.2.4", &[]) };
const DEFAULT_EXPERIMENT: Element = element(
    "DefaultExperiment",
    "2.2.5",
    &[may("startTime", Double), may("stopTime", Double), may("tolerance", Double), may("stepSize", Double)],
);
const TOOL: Element = Element { holds: None, ..element("Tool", "2.2.6", &[must("name", Any)]) };
const VENDOR_ANNOTATIONS: Element =
    Element { holds: Some(&[many(&[&TOOL])]), ..element("VendorAnnotations", "2.2.6", &[]) };
const ANNOTATIONS: Element = Element { holds: Some(&[many(&[&TOOL])]), ..element("Annotations", "2.2.7", &[]) };
const REAL: Element = element(
    "Real",
    "2.2.7",
    &[
        may("declaredType", Any),
        may("quantity", Any),
        may("unit", Any),
        may("displayUnit", Any),
        may("relativeQuantity", Boolean),
        may("min", Double),
        may("max", Double),
        may("nominal", Double),
        may("unbounded", Boolean),
        may("start", Double),
        may("derivative", Unsigned),
        may("reinit", Boolean),
    ],
);
const INTEGER: Element = element(
    "Integer",
    "2.2.7",
    &[may("declaredType", Any), may("quantity", Any), may("min", Int), may("max", Int), may("start", Int)],
);
const BOOLEAN: Element = element("Boolean", "2.2.7", &[may("declaredType", Any), may("start", Boolean)]);
const STRING: Element = element("String", "2.2.7", &[may("declaredType", Any), may("start", Any)]);
const ENUMERATION: Element = element(
    "Enumeration",
    "2.2.7",
    &[must("declaredType", Any), may("quantity", Any), may("min", Int), may("max", Int), may("start", Int)],
);
const SCALAR_VARIABLE: Element = Element {
    holds: Some(&[one(&[&REAL, &INTEGER, &BOOLEAN, &STRING, &ENUMERATION]), optional(&[&ANNOTATIONS])]),
    ..element(
        "ScalarVariable",
        "2.2.7",
        &[
            must("name", Any),
            must("valueReference", Unsigned),
            may("description", Any),
            may("causality", OneOf(&["parameter", "calculatedParameter", "input", "output", "local", "independent"])),
            may("variability", OneOf(&["constant", "fixed", "tunable", "discrete", "continuous"])),
            may("initial", OneOf(&["exact", "approx", "calculated"])),
            may("canHandleMultipleSetPerTimeInstant", Boolean),
        ],
    )
};
const MODEL_VARIABLES: Element =
    Element { holds: Some(&[many(&[&SCALAR_VARIABLE])]), ..element("ModelVariables", "2.2.7", &[]) };
const UNKNOWN: Element = element(
    "Unknown",
    "2.2.8",
    &[must("index", Unsigned), may("dependencies", Indices), may("dependenciesKind", Kinds)],
);
const UNKNOWNS: &[Part] = &[many(&[&UNKNOWN])];
const MODEL_STRUCTURE: Element = Element {
    holds: Some(&[
        optional(&[&Element { holds: Some(UNKNOWNS), ..element("Outputs", "2.2.8", &[]) }]),
        optional(&[&Element { holds: Some(UNKNOWNS), ..element("Derivatives", "2.2.8", &[]) }]),
        optional(&[&Element { holds: Some(UNKNOWNS), ..element("InitialUnknowns", "2.2.8", &[]) }]),
    ]),
    ..element("ModelStructure", "2.2.8", &[])
};
const ROOT: Element = Element {
    holds: Some(&[
        Part { elements: &[&MODEL_EXCHANGE, &CO_SIMULATION], least: 1, most: 2 },
        optional(&[&UNIT_DEFINITIONS]),
        optional(&[&TYPE_DEFINITIONS]),
        optional(&[&LOG_CATEGORIES]),
        optional(&[&DEFAULT_EXPERIMENT]),
        optional(&[&VENDOR_ANNOTATIONS]),
        one(&[&MODEL_VARIABLES]),
        one(&[&MODEL_STRUCTURE]),
    ]),
    ..element(
        "fmiModelDescription",
        "2.2.1",
        &[
            must("fmiVersion", OneOf(&["2.0"])),
            must("modelName", Any),
            must("guid", Any),
            may("description", Any),
            may("author", Any),
            may("version", Any),
            may("copyright", Any),
            may("license", Any),
            may("generationTool", Any),
            may("generationDateAndTime", DateTime),
            may("variableNamingConvention", OneOf(&["flat", "structured"])),
            may("numberOfEventIndicators", Unsigned),
        ],
    )
};

/// Checks a document. Returns true for a description of FMI 2.0, so that further checks make sense.
pub(super) fn check(root: Node, lines: &Lines, findings: &mut Findings) -> bool {
    if root.tag_name().name() != ROOT.name {
        let what = format!("the root is `{}`, not `{}`", root.tag_name().name(), ROOT.name);
        findings.error(lines.at(root), what, "2.2.1", "use the modelDescription.xml of an FMU");
        return false;
    }
    if let Some(version) = root.attribute("fmiVersion").filter(|version| version.trim() != "2.0") {
        let what = format!("fmiVersion = \"{version}\"");
        findings.error(
            lines.at(root),
            what,
            "2.2.1",
            "only FMI 2.0 and 3.0 are checked; write it as \"2.0\" or \"3.0\"",
        );
        return false;
    }
    check_element(&ROOT, root, lines, findings);
    true
}

fn check_element(known: &Element, node: Node, lines: &Lines, findings: &mut Findings) {
    check_attributes(known, node, lines, findings);
    let Some(parts) = known.holds else { return };
    if node.tag_name().namespace().is_some() {
        let what = format!("{} is in a namespace", known.name);
        findings.error(lines.at(node), what, known.section, "remove the namespace; elements of the standard have none");
    }
    let text = node.children().any(|child| child.is_text() && !child.text().unwrap_or_default().trim().is_empty());
    if text {
        let what = format!("{} contains text between its elements", known.name);
        findings.error(lines.at(node), what, known.section, "remove the text");
    }
    check_children(known, parts, node, lines, findings);
}

fn check_attributes(known: &Element, node: Node, lines: &Lines, findings: &mut Findings) {
    // Attributes with a namespace, as `xsi:noNamespaceSchemaLocation`, are for XML tools.
    for given in node.attributes().filter(|given| given.namespace().is_none()) {
        let (name, value) = (given.name(), given.value());
        let Some(attribute) = known.attributes.iter().find(|attribute| attribute.name == name) else {
            let what = format!("{} does not allow the attribute `{name}`", known.name);
            findings.error(lines.at(node), what, known.section, "remove it");
            continue;
        };
        if let Some(allowed) = attribute.kind.refusal(value) {
            let what = format!("{name} = \"{value}\" in {}", known.name);
            findings.error(lines.at(node), what, known.section, format!("it must be {allowed}"));
        }
    }
    for missing in known.attributes.iter().filter(|attribute| attribute.required) {
        if node.attribute(missing.name).is_none() {
            let what = format!("{} lacks the required attribute `{}`", known.name, missing.name);
            findings.error(lines.at(node), what, known.section, "add it");
        }
    }
}

fn check_children(known: &Element, parts: &'static [Part], node: Node, lines: &Lines, findings: &mut Findings) {
    let mut counts = vec![0; parts.len()];
    let mut reached = 0;
    for child in node.children().filter(Node::is_element) {
        let name = child.tag_name().name();
        let place = parts.iter().enumerate().find_map(|(k, part)| {
            part.elements.iter().find(|element| element.name == name).map(|element| (k, *element))
        });
        let Some((k, element)) = place else {
            let what = format!("{} does not allow the element `{name}`", known.name);
            let tools = "remove it; put tool-specific data into VendorAnnotations or Annotations";
            findings.error(lines.at(child), what, known.section, tools);
            continue;
        };
        if k < reached {
            let what = format!("{name} must come before {}", names(&parts[reached]));
            let order: Vec<_> = parts.iter().map(names).collect();
            findings.error(lines.at(child), what, known.section, format!("the order is {}", order.join(", ")));
        }
        reached = reached.max(k);
        counts[k] += 1;
        if counts[k] > parts[k].most {
            let what = format!("{} contains {} more than {} times", known.name, names(&parts[k]), parts[k].most);
            findings.error(lines.at(child), what, known.section, "remove the surplus elements");
        }
        check_element(element, child, lines, findings);
    }
    for (part, count) in parts.iter().zip(counts) {
        if count < part.least {
            let what = format!("{} contains no {}", known.name, names(part));
            findings.error(lines.at(node), what, known.section, "add it");
        }
    }
}

fn names(part: &Part) -> String {
    let names: Vec<_> = part.elements.iter().map(|element| element.name).collect();
    names.join(" or ")
}
