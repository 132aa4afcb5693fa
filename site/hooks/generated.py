"""Pages that are made when the site is built: of what the program says about itself, of the descriptions of FMUs, and of
the study that reproduces the thesis."""

import json
import os
import re
import shutil
import subprocess
import tempfile
import textwrap
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

# A folder that `report` has left: with it the site holds the report.
REPORT = "ADAPTIVE_FMU_REPORT"
# How wide help is on the page, and an option with what it does.
WIDTH = 88
# Where the site has the league's page.
LEAGUE = "league_results/index.html"
OPTION = re.compile(r"^(?P<option> +\S.*?  +)(?P<text>\S.*)$")
ROW = re.compile(r"^\| `(\w+)` \| \[.*?\]\((\S+?\.md)\) \|", re.M)
ELEMENT = re.compile(r"^(?P<array>.*?)\[[\d,]+\]$")


def on_files(files, config):
    root = Path(config.config_file_path).parent
    pages = {
        "reference/commands.md": commands(root),
        "reference/keys.md": keys(json.loads(printed(root, "schema"))),
        "reference/corrections.md": corrections(root / "examples" / "thesis.toml"),
    }
    # The table of FMUs names the page of each one's equations.
    equations = dict(ROW.findall((Path(config.docs_dir) / "fmus.md").read_text(encoding="utf-8")))
    for file in sorted((root / "modelDescription").glob("*.xml")):
        pages[f"reference/fmus/{file.stem}.md"] = unit(file, equations[file.stem])
    for place, text in pages.items():
        files.append(File.generated(config, place, content=text))
    files.append(File.generated(config, LEAGUE, content=league(root)))
    if report := os.environ.get(REPORT):
        if not (Path(report) / "index.html").is_file():
            raise PluginError(f"{REPORT}: {report} has no index.html: is it what `adaptive-fmu report` leaves?")
        for file in (file for file in sorted(Path(report).rglob("*")) if file.is_file()):
            place = f"thesis/{file.relative_to(report).as_posix()}"
            files.append(File.generated(config, place, abs_src_path=str(file.resolve())))
    return files


def on_page_markdown(markdown, page, config, files):
    """In the table of FMUs each name leads to the page of its variables; the pages of loops and league lead to report and results."""
    if page.file.src_uri == "thesis_loops.md" and REPORT in os.environ:
        return markdown + "\n[The report of this version](thesis/index.html){ .md-button }\n"
    if page.file.src_uri == "league.md":
        return markdown.replace("`site/league`", f"[a page of their own]({LEAGUE})", 1)
    if page.file.src_uri != "fmus.md":
        return markdown
    return re.sub(r"^\| `(\w+)` \|", r"| [`\1`](reference/fmus/\1.md) |", markdown, flags=re.M)


def league(root: Path) -> str:
    """The page of the league's results, which are kept."""
    with tempfile.TemporaryDirectory() as folder:
        results = shutil.copytree(root / "site" / "league", Path(folder) / "results")
        study = root / "examples" / "league" / "league.toml"
        printed(root, "league", "--page", "--study", str(study), "--out", str(results))
        return (results / "index.html").read_text(encoding="utf-8")


def printed(root: Path, *arguments: str) -> str:
    """What the program prints."""
    program = Path(os.environ.get("ADAPTIVE_FMU_PROGRAM") or root / "target" / "release" / "adaptive-fmu")
    if not program.is_file():
        raise PluginError(f"{program} isn't there: build it (cargo build --release), or name it by ADAPTIVE_FMU_PROGRAM")
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise PluginError(f"{program} {' '.join(arguments)}: {done.stderr}")
    return done.stdout


def cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")


# Commands ----------------------------------------------------------------------------------------------------------------


def commands(root: Path) -> str:
    names = subcommands(printed(root, "--help"))
    names.insert(names.index("new") + 1, "new loop")
    text = "# Commands\n\nWhat `--help` prints of each command.\n\n## adaptive-fmu\n\n" + help_of(root)
    return text + "".join(f"\n## {name}\n\n{help_of(root, *name.split())}" for name in names)


def subcommands(text: str) -> list[str]:
    """Names of the commands, which stand in groups."""
    return [name for name in re.findall(r"^  ([a-z]+) {2,}[A-Z]", text, re.M) if name != "help"]


def help_of(root: Path, *command: str) -> str:
    lines = [part for line in printed(root, *command, "--help").rstrip().splitlines() for part in wrapped(line)]
    return "```text\n" + "\n".join(lines) + "\n```\n"


def wrapped(line: str) -> list[str]:
    """A line of help, no wider than the page: what follows an option stays in its column, or goes below it."""
    if len(line) <= WIDTH:
        return [line]
    option = OPTION.match(line)
    if option is None:
        indent = " " * (len(line) - len(line.lstrip()))
        return textwrap.wrap(line, WIDTH, subsequent_indent=indent)
    first, indent = option["option"], len(option["option"])
    if indent <= WIDTH // 3:
        return textwrap.wrap(first + option["text"], WIDTH, subsequent_indent=" " * indent, drop_whitespace=True)
    below = " " * 10
    return [first.rstrip(), *textwrap.wrap(option["text"], WIDTH, initial_indent=below, subsequent_indent=below)]


# Keys of descriptions ----------------------------------------------------------------------------------------------------


def keys(schema: dict) -> str:
    text = (
        "# Keys by model\n\nWhat a description may hold, from the schema that `adaptive-fmu schema` prints. Start values are "
        "listed with each [FMU](../fmus.md); how keys are used is explained in [Descriptions](../description.md).\n\n"
        "## Every description\n\n"
    )
    text += table(schema)
    for case in schema["allOf"]:
        structure = case["then"].get("properties", {}).get("structure", {})
        text += f"\n## `{case['if']['properties']['model']['const']}`\n\n"
        if structure.get("properties"):
            text += structure.get("description", "") + "\n\n" + table(structure, "structure.")
        else:
            text += "There is nothing to choose: `[structure]` is empty.\n"
    return text


def table(schema: dict, prefix: str = "") -> str:
    return "| key | what it is | type | required |\n| --- | --- | --- | --- |\n" + "".join(rows(schema, prefix))


def rows(schema: dict, prefix: str) -> list[str]:
    found = []
    for name, key in sorted(schema.get("properties", {}).items()):
        required = "yes" if name in schema.get("required", []) else ""
        what = cell(key.get("description", ""))
        if "default" in key and key["default"] not in ([], {}, None):
            what += f" `{json.dumps(key['default'], ensure_ascii=False)}` unless given."
        found.append(f"| `{prefix}{name}` | {what} | {cell(kind(key))} | {required} |\n")
        if key.get("properties"):
            found += rows(key, f"{prefix}{name}.")
    return found


def kind(key: dict) -> str:
    if items := [item["const"] for item in key.get("oneOf", []) if "const" in item] or key.get("enum"):
        return ", ".join(f"`{json.dumps(item)}`" for item in items)
    if choices := [one for one in key.get("anyOf", []) + key.get("oneOf", []) if one.get("type") != "null"]:
        return " or ".join(dict.fromkeys(kind(one) for one in choices))
    types = key.get("type", "anything")
    types = [one for one in ([types] if isinstance(types, str) else types) if one != "null"]
    words = {"object": "table", "array": "list", "string": "text", "boolean": "true or false", "integer": "whole number"}
    what = " or ".join(words.get(one, one) for one in types)
    items = key.get("items")
    return f"{what} of: {kind(items)}" if types == ["array"] and isinstance(items, dict) else what


# FMUs --------------------------------------------------------------------------------------------------------------------


def unit(file: Path, equations: str) -> str:
    root = ET.parse(file).getroot()
    variables = root.find("ModelVariables")
    if variables is None:
        raise PluginError(f"{file} has no variables")
    parts: dict[str, list[str]] = {"input": [], "output": [], "parameter": [], "local": []}
    for row, causality in arrays(list(variables)):
        parts.get(causality, parts["local"]).append(row)
    text = f"# {root.get('modelName')}\n\n{root.get('description')}.\n\n"
    experiment = root.find("DefaultExperiment")
    if experiment is not None:
        asked = {"stop time": "stopTime", "communication step": "stepSize"}
        values = [f"{name} {value} s" for name, key in asked.items() if (value := experiment.get(key))]
        text += f"Default experiment: {', '.join(values)}. "
    text += f"[Its equations](../../{equations}) are in the FMU's own documentation, too. [All FMUs](../../fmus.md).\n"
    titles = {"input": "Inputs", "output": "Outputs", "parameter": "Parameters", "local": "Others"}
    head = "| name | what it is | unit | start | limits | changes |\n| --- | --- | --- | --- | --- | --- |\n"
    return text + "".join(f"\n## {titles[part]}\n\n{head}{''.join(found)}" for part, found in parts.items() if found)


def arrays(variables: list[ET.Element]) -> list[tuple[str, str]]:
    """A row for each variable, or for the elements of an array that differ in nothing but their start values."""
    groups: list[list[ET.Element]] = []
    for variable in variables:
        if groups and alike(groups[-1][-1], variable):
            groups[-1].append(variable)
        else:
            groups.append([variable])
    return [(row(group), group[0].get("causality", "local")) for group in groups]


def alike(one: ET.Element, other: ET.Element) -> bool:
    names = [ELEMENT.match(variable.get("name", "")) for variable in (one, other)]
    same = [[variable.get(key) for key in ("causality", "variability", "description")] for variable in (one, other)]
    types = [{**variable[0].attrib, "start": "", "derivative": ""} for variable in (one, other)]
    return (
        None not in names
        and names[0]["array"] == names[1]["array"]
        and same[0] == same[1]
        and [one[0].tag, types[0]] == [other[0].tag, types[1]]
    )


def row(group: list[ET.Element]) -> str:
    first, last = (f"`{variable.get('name')}`" for variable in (group[0], group[-1]))
    name = first if len(group) == 1 else f"{first} … {last}"
    kind = group[0][0]
    starts = list(dict.fromkeys(variable[0].get("start", "") for variable in group))
    start = ", ".join(starts) if len(starts) <= 6 else f"{starts[0]} …"
    low, high = kind.get("min"), kind.get("max")
    limits = " … ".join([low or "", high or ""]) if low or high else ""
    what, unit, changes = group[0].get("description", ""), kind.get("unit", ""), group[0].get("variability", "continuous")
    return f"| {name} | {cell(what)} | {unit} | {start} | {limits} | {changes} |\n"


# Corrections -------------------------------------------------------------------------------------------------------------


def corrections(study: Path) -> str:
    text = (
        "# Corrections to the thesis\n\nThese are the places where equations or numbers of the [thesis](../theory.md#sources) were "
        "changed before its examples worked, or where it leaves something open. The "
        "[report](../thesis_loops.md#reproduce-the-thesis) has the same list with measured values.\n"
    )
    for example in tomllib.loads(study.read_text(encoding="utf-8"))["example"]:
        if found := example.get("corrections"):
            text += f"\n## {example['name']}: {example['title']}\n\n" + "".join(f"- {one}\n" for one in found)
    return text
