"""FMUs, packed loops, structures (.ssd) and parameter sets (.ssv) that are broken or meant to do harm."""

import random
import shutil
import stat
import zipfile
from pathlib import Path

import pytest
from conftest import ROOT, files_in
from master import PLANT
from test_loops import SQUARE, archive, change

LOOP = ROOT / "examples" / "3.2.1-cosine"
SSD = (LOOP / "SystemStructure.ssd").read_text()
HEAD = '<?xml version="1.0"?>'
LAUGHS = "".join(f"<!ENTITY l{k} '" + f"&l{k - 1};" * 10 + "'>" for k in range(1, 10))
ATTRIBUTES = " ".join(f"a{k}=''" for k in range(300_000))

# What stands in an XML file, and a word of what is told.
XML: dict[str, tuple[str | bytes, str]] = {
    "empty": ("", "root"),
    "text": ("no XML", ""),
    "no UTF-8": (b"<a>\n\xff</a>", ""),
    "UTF-16": ('<?xml version="1.0" encoding="UTF-16"?><a/>'.encode("utf-16"), ""),
    "zeros": (bytes(1000), ""),
    "billion laughs": (f'{HEAD}<!DOCTYPE a [<!ENTITY l0 "ha">{LAUGHS}]><a>&l9;</a>', "DTD"),
    "a file of others": (f'{HEAD}<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]><a>&x;</a>', "DTD"),
    "an unknown entity": (f"{HEAD}<a>&x;</a>", ""),
    "deep": ("<a>" * 200_000, ""),
    "deep and closed": ("<a>" * 200_000 + "</a>" * 200_000, ""),
    "attributes": (f"<a {ATTRIBUTES}/>", "attributes"),
    "attributes of many": (f"<a>{f'<b {ATTRIBUTES[:7000]}/>' * 500}</a>", "attributes"),
    "elements": (f"<a>{'<a/>' * 2_100_000}</a>", ""),
    "another root": (f"{HEAD}<a/>", ""),
    "a long name": (f"<{'a' * 1_000_000}/>", ""),
    "a character that XML can't hold": (f'{HEAD}<a version="&#27;"/>', "entity"),
}


@pytest.fixture
def loop(tmp_path: Path, fmu_folder: Path) -> Path:
    """A copy of the cosine loop with its FMUs beside it."""
    shutil.copytree(LOOP, tmp_path / "loop")
    (tmp_path / "loop" / "resources").symlink_to(fmu_folder)
    return tmp_path / "loop"


def reported_in_a_line(answer, word: str) -> None:
    assert (answer.returncode, answer.stdout) == (1, ""), answer
    assert word in answer.stderr and answer.stderr.count("\n") == 1 and len(answer.stderr) < 5000, answer.stderr
    assert "\x1b" not in answer.stderr


@pytest.mark.parametrize("name", XML)
def test_hostile_xml_is_refused_wherever_it_is(bounded, loop: Path, name: str, tmp_path: Path) -> None:
    content, word = XML[name]
    content = content.encode() if isinstance(content, str) else content
    (tmp_path / "case.ssv").write_bytes(content)
    (tmp_path / "its.ssd").write_bytes(content)
    archive(tmp_path / "its.fmu", ("modelDescription.xml", content))
    archive(tmp_path / "its.ssp", ("SystemStructure.ssd", content))
    before = files_in(tmp_path)
    for arguments in [
        ("info", "its.fmu"),
        ("linearise", "its.fmu"),
        ("run", "its.ssd"),
        ("run", "its.ssp"),
        ("run", loop, "--case", "case.ssv"),
        ("export", PLANT, "--values", "case.ssv"),
    ]:
        reported_in_a_line(bounded(*arguments, folder=tmp_path), word)
    assert {file for file in files_in(tmp_path) if not file.startswith("fmus/")} == before


BINDING = 'source="reference.ssv"'
SOURCE = f'source="resources/{PLANT}.fmu"'
# What is changed in the structure, and what is told of it.
STRUCTURES: dict[str, tuple[str, str, str]] = {
    "FMU above": (SOURCE, 'source="resources/../../up.fmu"', "../../up.fmu"),
    "FMU anywhere": (SOURCE, 'source="/etc/passwd"', "/etc/passwd"),
    "FMU of the network": (SOURCE, 'source="http://example.com/a.fmu"', "http"),
    "FMU that is the structure": (SOURCE, 'source="SystemStructure.ssd"', "resources/NAME.fmu"),
    "values above": (BINDING, 'source="../secret.ssv"', "../secret.ssv"),
    "values anywhere": (BINDING, 'source="/etc/passwd"', "/etc/passwd"),
    "values that are the structure": (BINDING, 'source="SystemStructure.ssd"', "not a ParameterSet"),
    "values that are a folder": (BINDING, 'source="resources"', "regular file"),
    "a name with a line end": ('name="plant"', 'name="pl&#10;ant"', "control character"),
    "two of one name": ('name="plant"', 'name="controller"', "two components"),
    "a name that is a path": ('name="3.2.1-cosine"', 'name="../../up"', "letters, digits"),
    "end beyond all": ('stopTime="', 'stopTime="1e999', "finite"),
    "end far away": ('stopTime="', 'stopTime="1e308" x="', "communication points"),
    "no step": ('step="', 'step="0" x="', "above 0"),
    "smallest step": ('step="', 'step="1e-308" x="', "communication points"),
    "step that is none": ('step="', 'step="nan" x="', "finite"),
    "a limit that is none": ('limit="', 'limit="inf" x="', "finite"),
    "a model of no numbers": ('denominator="', 'denominator="nan nan" x="', "finite"),
    "a model that overflows": ('denominator="', 'denominator="1e-300 1e300 1e300 1" x="', "1e100"),
    "signals in the structure": ("<ssd:Elements>", '<ssd:Elements><ssd:SignalDictionaryReference name="x"/>', "SignalDictionaryReference"),
}


@pytest.mark.parametrize("name", STRUCTURES)
def test_a_hostile_structure_is_refused_with_its_line(bounded, loop: Path, name: str, tmp_path: Path) -> None:
    old, new, word = STRUCTURES[name]
    (tmp_path / "secret.ssv").write_text(SQUARE)
    change(loop / "SystemStructure.ssd", old, new)
    before = files_in(tmp_path)
    answer = bounded("run", loop, "--out", "out", folder=tmp_path)
    reported_in_a_line(answer, word)
    assert "SystemStructure.ssd" in answer.stderr
    assert ("line " in answer.stderr) == (word != "communication points"), answer.stderr
    assert files_in(tmp_path) == before


def description(fmu) -> str:
    with zipfile.ZipFile(fmu(PLANT).path) as opened:
        return opened.read("modelDescription.xml").decode()


def test_a_hostile_fmu_is_refused_and_leaves_nothing(bounded, fmu, tmp_path: Path) -> None:
    xml = description(fmu)
    plain = ("modelDescription.xml", xml)
    identifier = lambda name: xml.replace(f'modelIdentifier="{PLANT}"', f'modelIdentifier="{name}"')  # noqa: E731
    shutil.copy(next(fmu(PLANT).folder.glob("binaries/linux64/*.so")), tmp_path / "outside.so")
    link = zipfile.ZipInfo("resources/link")
    link.create_system, link.external_attr = 3, (stat.S_IFLNK | 0o777) << 16
    entries = {
        "library outside": ([("modelDescription.xml", identifier(f"../../../{tmp_path.name}/outside"))], "C identifier"),
        "library anywhere": ([("modelDescription.xml", identifier(f"{tmp_path}/outside"))], "C identifier"),
        "no library": ([plain], "binaries/linux64"),
        "broken library": ([plain, (f"binaries/linux64/{PLANT}.so", "no library")], "invalid ELF header|too short"),
        "above": ([plain, ("../escaped", "x")], "outside"),
        "anywhere": ([plain, (f"{tmp_path}/escaped", "x")], "outside|binaries/linux64"),
        "twice": ([plain, plain], "several entries"),
        "one path twice": ([plain, ("./modelDescription.xml", xml)], "several entries"),
        "a folder that is a file": ([plain, ("a", "x"), ("a/b", "x")], "a"),
        "a link": ([plain, (link, "/etc/passwd"), ("resources/link/x", "x")], "link"),
        "a bomb": ([("modelDescription.xml", " " * 80_000_000)], "longer than"),
        "many files": ([plain, *((f"{k}", "") for k in range(10_001))], "10000"),
        "no description": ([("a", "x")], "modelDescription.xml"),
        "reference beyond all": (
            [("modelDescription.xml", xml.replace('valueReference="', 'valueReference="99999999999'))],
            "valueReference",
        ),
        "output that is no variable": ([("modelDescription.xml", xml.replace('index="', 'index="-'))], "index"),
    }
    files = {
        name: (archive(tmp_path / f"{k}.fmu", *content), words)
        for k, (name, (content, words)) in enumerate(entries.items())
    }
    whole = fmu(PLANT).path.read_bytes()
    for name, content in [("half", whole[: len(whole) // 2]), ("none", b""), ("head alone", whole[:30])]:
        (tmp_path / f"{name}.fmu").write_bytes(content)
        files[name] = (tmp_path / f"{name}.fmu", "archive")
    before = files_in(tmp_path)
    for name, (file, words) in files.items():
        answer = bounded("linearise", file, folder=tmp_path)
        reported_in_a_line(answer, file.name)
        assert any(word in answer.stderr for word in words.split("|")), (name, answer.stderr)
        bounded("info", file, folder=tmp_path)
    assert files_in(tmp_path) == before


def test_byte_order_marks_and_other_line_ends_of_structures_do_no_harm(bounded, loop: Path, tmp_path: Path) -> None:
    for file in [loop / "SystemStructure.ssd", loop / "reference.ssv"]:
        file.write_bytes(b"\xef\xbb\xbf" + file.read_text().replace("\n", "\r\n").encode())
    answer = bounded("run", loop, "--until", "0.01", folder=tmp_path)
    assert answer.returncode in (0, 3), answer


def mutated(content: bytes, chance: random.Random) -> bytes:
    """With some bytes, a piece or a number changed."""
    changed, place = bytearray(content), chance.randrange(len(content))
    match chance.randrange(5):
        case 0:
            del changed[place:]
        case 1:
            del changed[place : place + chance.randrange(1, 200)]
        case 2:
            changed[place:place] = changed[chance.randrange(len(content)) :][: chance.randrange(1, 200)]
        case 3:
            for _ in range(chance.randrange(1, 8)):
                changed[chance.randrange(len(changed))] = chance.randrange(256)
        case _:
            digits = [k for k, byte in enumerate(content) if 48 <= byte <= 57]
            numbers = [b"1e308", b"-1", b"nan", b"9223372036854775808", b"4294967295", b"0", b"1e-320", b"", b"x"]
            place = chance.choice(digits)
            changed[place : place + 1] = chance.choice(numbers)
    return bytes(changed)


def test_no_change_of_a_structure_or_a_parameter_set_leads_to_a_fault(bounded, loop: Path, tmp_path: Path) -> None:
    chance = random.Random(31)
    for name, count in [("SystemStructure.ssd", 60), ("reference.ssv", 20)]:
        content = (loop / name).read_bytes()
        for _ in range(count):
            (loop / name).write_bytes(mutated(content, chance))
            bounded("run", loop, "--until", "0.01", "--step", "0.001", "--out", "out", folder=tmp_path)
        (loop / name).write_bytes(content)
    assert {file.split("/")[0] for file in files_in(tmp_path)} <= {"loop", "out"}


def test_no_change_of_an_fmu_leads_to_a_fault(bounded, fmu, tmp_path: Path) -> None:
    chance, content, xml = random.Random(47), fmu(PLANT).path.read_bytes(), description(fmu).encode()
    for k in range(60):
        # The directory of an archive stands at its end; a library that was changed is never loaded.
        tail = len(content) - 1200
        hostile = content[:tail] + mutated(content[tail:], chance) if k % 2 else mutated(content, chance)
        (tmp_path / "its.fmu").write_bytes(hostile)
        bounded("info", "its.fmu", folder=tmp_path)
        if k < 12:
            bounded("linearise", "its.fmu", folder=tmp_path)
    for _ in range(40):
        archive(tmp_path / "its.fmu", ("modelDescription.xml", mutated(xml, chance)))
        bounded("info", "its.fmu", folder=tmp_path)
    assert files_in(tmp_path) == {"its.fmu"}
