//! The wiring diagram and the table of connections. Blocks are one below the other, in the order in which a signal
//! passes through a loop, which leaves room for names next to the wires even on a phone.

use std::fmt::Write;

use super::wiring::{From, Link, Wiring, shown};
use super::{Handed, escaped};
use crate::catalogue::Role;
use crate::exporter::pins::{ranges, runs};

/// Width of a block, and of a character of a pin's name; heights of lines.
const WIDTH: usize = 224;
const CHARACTER: usize = 7;
const LINE: usize = 14;
/// Characters in a line of a block, and next to it.
const INSIDE: usize = 31;
const OUTSIDE: usize = 17;
/// Distance between wires that go past blocks.
const LANE: usize = 14;

/// Appends the diagram with its table.
pub fn push(page: &mut String, wiring: &Wiring, handed: &Handed) {
    let what = match wiring.from {
        From::Loop(name) => format!(
            "As in the loop <code>{0}</code>. <code>adaptive-fmu export --ssp {0}</code> writes the loop for other \
             tools.",
            escaped(name)
        ),
        From::Itself(_) => "The parts are connected inside.".to_owned(),
        From::Kind if wiring.links.is_empty() => {
            "Inputs and outputs of this FMU. You choose what to connect.".to_owned()
        }
        From::Kind => "Dashed: other FMUs of your loop. Names of their inputs and outputs may differ.".to_owned(),
    };
    let _ = write!(page, "<h2 id=\"wiring\">Wiring</h2>\n<p>{what}</p>\n<div class=\"row\">\n");
    page.push_str(&Diagram::new(wiring, handed).svg());
    push_table(page, wiring, handed);
    page.push_str("</div>\n");
}

/// Appends the table of connections, and the pins that may stay open.
fn push_table(page: &mut String, wiring: &Wiring, handed: &Handed) {
    let is_whole = matches!(wiring.from, From::Itself(_));
    let mut rows = String::new();
    let touches = |link: &&Link| !is_whole && (wiring.parts[link.from].is_own || wiring.parts[link.to].is_own);
    for link in wiring.links.iter().filter(touches) {
        let name = |part: usize| {
            let part = &wiring.parts[part];
            if part.is_own { String::new() } else { format!("{}.", part.name) }
        };
        for [from, to] in runs(link.pairs.iter().map(|(from, to)| [from.as_str(), to.as_str()])) {
            let end = |part: usize, pin: &str| {
                let tag = if wiring.parts[part].is_own { "b" } else { "span" };
                format!("<{tag}><code>{}{}</code></{tag}>", escaped(&name(part)), escaped(pin))
            };
            let _ = writeln!(rows, "<tr><td>{}<td>{}", end(link.from, &from), end(link.to, &to));
        }
    }
    let open = |inputs: bool| {
        let own = wiring.parts.iter().enumerate().filter(|(_, part)| part.is_own);
        let pins = own.flat_map(|(place, part)| {
            let prefix = if is_whole { format!("{}.", part.name) } else { String::new() };
            let mut pins = shown(handed, wiring, place, inputs, false);
            if is_whole && !inputs {
                pins.splice(0..0, shown(handed, wiring, place, inputs, true));
            }
            pins.into_iter().map(move |pin| format!("<code>{}</code>", escaped(&format!("{prefix}{pin}"))))
        });
        pins.collect::<Vec<_>>().join(", ")
    };
    let is_known = is_whole || !rows.is_empty();
    page.push_str("<div class=\"scroll\">\n");
    if !rows.is_empty() {
        let _ = writeln!(page, "<table>\n<tr><th>connect<th>to\n{rows}</table>");
    }
    for (inputs, before, after) in [
        (true, if is_known { "Inputs that may stay open: " } else { "Inputs: " }, "."),
        (false, if rows.is_empty() { "Outputs: " } else { "Further outputs, for monitoring: " }, "."),
    ] {
        let pins = open(inputs);
        if !pins.is_empty() {
            let _ = writeln!(page, "<p>{before}{pins}{after}</p>");
        }
    }
    page.push_str("</div>\n");
}

/// Route of a wire past blocks.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Way {
    /// Straight to the next block.
    Down,
    /// Up again, on the left.
    Left,
    /// Down past others, on the right.
    Right,
}

struct Wire<'a> {
    link: &'a Link,
    from: usize,
    to: usize,
    way: Way,
    lane: usize,
    labels: Vec<String>,
}

struct Block {
    part: usize,
    lines: Vec<(&'static str, String)>,
    top: usize,
    height: usize,
}

struct Diagram<'a> {
    wiring: &'a Wiring,
    blocks: Vec<Block>,
    wires: Vec<Wire<'a>>,
    /// Left edge of the blocks, and the size of the diagram.
    left: usize,
    width: usize,
    height: usize,
}

/// Place of a role in the order of blocks.
fn rank(role: Option<Role>) -> usize {
    match role {
        Some(Role::Reference) => 0,
        Some(Role::Controller) => 1,
        Some(Role::Actuator | Role::Excitation) => 2,
        Some(Role::Plant | Role::Composite) | None => 3,
        Some(Role::Sensor) => 4,
        Some(Role::Observer) => 5,
    }
}

/// Joins pieces by commas to lines of some width.
fn lines(pieces: &[String], width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for piece in pieces {
        match lines.last_mut() {
            Some(line) if line.chars().count() + piece.chars().count() + 2 <= width => {
                line.push_str(", ");
                line.push_str(piece);
            }
            _ => lines.push(piece.clone()),
        }
    }
    lines
}

impl<'a> Diagram<'a> {
    fn new(wiring: &'a Wiring, handed: &Handed) -> Self {
        let mut order: Vec<usize> = (0..wiring.parts.len()).collect();
        order.sort_by_key(|part| (rank(wiring.parts[*part].role), *part));
        let place = |part: usize| order.iter().position(|other| *other == part).unwrap_or(0);
        let mut wires: Vec<Wire> =
            wiring.links.iter().map(|link| Wire::new(link, place(link.from), place(link.to))).collect();
        for way in [Way::Left, Way::Right] {
            let mut passing: Vec<&mut Wire> = wires.iter_mut().filter(|wire| wire.way == way).collect();
            passing.sort_by_key(|wire| wire.from.abs_diff(wire.to));
            passing.into_iter().enumerate().for_each(|(lane, wire)| wire.lane = lane);
        }
        let blocks =
            order.iter().map(|part| Block { part: *part, lines: text(wiring, handed, *part), top: 0, height: 0 });
        let mut diagram = Diagram { wiring, blocks: blocks.collect(), wires, left: 0, width: 0, height: 0 };
        diagram.arrange();
        diagram
    }

    /// Places the blocks.
    fn arrange(&mut self) {
        let side = |way: Way| {
            let passing = self.wires.iter().filter(|wire| wire.way == way);
            let longest = passing.clone().flat_map(|wire| &wire.labels).map(|label| label.chars().count()).max();
            longest.map_or(10, |characters| CHARACTER * characters + 22 + LANE * passing.count())
        };
        let (left, right) = (side(Way::Left), side(Way::Right));
        let mut y = 10;
        for k in 0..self.blocks.len() {
            let at_side = |way| self.wires.iter().map(|wire| wire.room(k, way)).sum::<usize>();
            let own = 14 + LINE * self.blocks[k].lines.len();
            let height = own.max(10 + at_side(Way::Left)).max(10 + at_side(Way::Right));
            (self.blocks[k].top, self.blocks[k].height) = (y, height);
            let down = self.wires.iter().find(|wire| wire.way == Way::Down && wire.from == k);
            y += height + down.map_or(18, |wire| (LINE * wire.labels.len() + 18).max(34));
        }
        let last = self.blocks.last().map_or(0, |block| block.top + block.height);
        (self.left, self.width, self.height) = (left, left + WIDTH + right, last + 10);
    }

    fn svg(&self) -> String {
        let Diagram { width, height, .. } = self;
        let mut svg = format!(
            "<svg id=\"diagram\" role=\"img\" aria-label=\"wiring diagram\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\">\n"
        );
        if matches!(self.wiring.from, From::Itself(_)) {
            let (width, height) = (width - 4, height - 4);
            let _ =
                writeln!(svg, "<rect class=\"frame\" x=\"2\" y=\"2\" width=\"{width}\" height=\"{height}\" rx=\"8\"/>");
        }
        for block in &self.blocks {
            self.push_block(&mut svg, block);
        }
        for wire in &self.wires {
            self.push_wire(&mut svg, wire);
        }
        svg.push_str("</svg>\n");
        svg
    }

    fn push_block(&self, svg: &mut String, Block { part, lines, top, height }: &Block) {
        let part = &self.wiring.parts[*part];
        let is_inner = matches!(self.wiring.from, From::Itself(_));
        let class = match (part.is_own && !is_inner, part.is_any) {
            (true, _) => "block own",
            (_, true) => "block any",
            _ => "block",
        };
        let x = self.left;
        let _ = writeln!(
            svg,
            "<rect class=\"{class}\" x=\"{x}\" y=\"{top}\" width=\"{WIDTH}\" height=\"{height}\" rx=\"6\"/>"
        );
        for (k, (class, line)) in lines.iter().enumerate() {
            let (x, y) = (x + 10, top + 18 + LINE * k);
            let _ = writeln!(svg, "<text class=\"{class}\" x=\"{x}\" y=\"{y}\">{}</text>", escaped(line));
        }
    }

    fn push_wire(&self, svg: &mut String, wire: &Wire) {
        let (from, to) = (&self.blocks[wire.from], &self.blocks[wire.to]);
        let pairs: Vec<String> = wire.link.pairs.iter().map(|(from, to)| format!("{from} → {to}")).collect();
        let _ = write!(svg, "<g><title>{}</title>", escaped(&pairs.join(", ")));
        let count = wire.labels.len();
        if wire.way == Way::Down {
            let (x, y, end) = (self.left + WIDTH / 2, from.top + from.height, to.top);
            let _ = write!(svg, "<path class=\"wire\" d=\"M{x} {y}V{}\"/>", end - 6);
            let _ = write!(svg, "<path class=\"head\" d=\"M{x} {end}l-5 -9h10z\"/>");
            let first = (y + end).saturating_sub(LINE * count) / 2 + 10;
            self.push_labels(svg, wire, (x + 10, first), "start");
        } else {
            let (begin, end) = (self.port(wire, wire.from, true), self.port(wire, wire.to, false));
            let left = wire.way == Way::Left;
            let labels = wire.longest() * CHARACTER + 16;
            let widest = self.wires.iter().filter(|other| other.way == wire.way).map(|other| other.longest()).max();
            let reach = widest.map_or(labels, |longest| longest * CHARACTER + 16) + LANE * wire.lane;
            let (edge, lane, inward, anchor) = if left {
                (self.left, self.left - reach, -6, "end")
            } else {
                (self.left + WIDTH, self.left + WIDTH + reach, 6, "start")
            };
            let tip = edge as isize + inward;
            let _ = write!(svg, "<path class=\"wire\" d=\"M{edge} {begin}H{lane}V{end}H{tip}\"/>");
            let back = if left { "l-9 -5v10z" } else { "l9 -5v10z" };
            let _ = write!(svg, "<path class=\"head\" d=\"M{edge} {end}{back}\"/>");
            let x = if left { edge - 8 } else { edge + 8 };
            self.push_labels(svg, wire, (x, begin - 4 - LINE * (count - 1)), anchor);
        }
        svg.push_str("</g>\n");
    }

    fn push_labels(&self, svg: &mut String, wire: &Wire, (x, y): (usize, usize), anchor: &str) {
        for (k, label) in wire.labels.iter().enumerate() {
            let y = y + LINE * k;
            let text = escaped(label);
            let _ = write!(svg, "<text class=\"pin\" x=\"{x}\" y=\"{y}\" text-anchor=\"{anchor}\">{text}</text>");
        }
    }

    /// Height at which a wire meets a block: arriving wires first, then leaving ones below their labels.
    fn port(&self, wire: &Wire, block: usize, leaves: bool) -> usize {
        let mut y = self.blocks[block].top + 4;
        for leaving in [false, true] {
            let here = |other: &&Wire| (if leaving { other.from } else { other.to }) == block && other.way == wire.way;
            let mut here: Vec<&Wire> = self.wires.iter().filter(here).collect();
            // No wire crosses another one if the outer ones arrive and leave on the outside.
            here.sort_by_key(|other| other.lane);
            if leaving == (wire.way == Way::Right) {
                here.reverse();
            }
            for other in here {
                y += if leaving { other.room_leaving() } else { LINE };
                if leaving == leaves && std::ptr::eq(other.link, wire.link) {
                    return if leaving { y - 2 } else { y };
                }
            }
        }
        y
    }
}

impl<'a> Wire<'a> {
    fn new(link: &'a Link, from: usize, to: usize) -> Self {
        let way = match to {
            to if to == from + 1 => Way::Down,
            to if to > from => Way::Right,
            _ => Way::Left,
        };
        let names = ranges(link.pairs.iter().map(|(from, _)| from.as_str()));
        let labels = lines(&names, if way == Way::Down { INSIDE / 2 } else { OUTSIDE });
        Wire { link, from, to, way, lane: 0, labels }
    }

    fn longest(&self) -> usize {
        self.labels.iter().map(|label| label.chars().count()).max().unwrap_or(0)
    }

    fn room_leaving(&self) -> usize {
        LINE * self.labels.len() + 6
    }

    /// Height that it takes next to a block.
    fn room(&self, block: usize, way: Way) -> usize {
        let (arrives, leaves) = (self.to == block, self.from == block);
        if self.way != way {
            return 0;
        }
        usize::from(arrives) * LINE + usize::from(leaves) * self.room_leaving()
    }
}

/// Text of a block: its name, its title, and, for the FMU of the page, all pins.
fn text(wiring: &Wiring, handed: &Handed, place: usize) -> Vec<(&'static str, String)> {
    let part = &wiring.parts[place];
    let mut text = vec![("name", part.name.clone())];
    let title: String = part.title.chars().take(INSIDE + 2).collect();
    text.push(("soft", if title.len() < part.title.len() { format!("{}…", title.trim_end()) } else { title }));
    text.retain(|(_, line)| !line.is_empty());
    if !part.is_own {
        return text;
    }
    for (inputs, heading) in [(true, "inputs"), (false, "outputs")] {
        let [wired, open] = [true, false].map(|connected| shown(handed, wiring, place, inputs, connected));
        let pins: Vec<String> = wired.into_iter().chain(open).collect();
        if !pins.is_empty() {
            text.push(("soft", heading.to_owned()));
            text.extend(lines(&pins, INSIDE).into_iter().map(|line| ("pin", line)));
        }
    }
    text
}
