"""Who else is on this machine: what the server of `explore` keeps to itself, and what stays although a page is asked to write."""

import contextlib
import os
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest
from conftest import adaptive_fmu
from test_explore import AMPLITUDE, LOOP, Explored, ran, slider
from test_explore import browser as browser  # noqa: PLC0414 (fixtures)
from test_explore import explored as explored  # noqa: PLC0414
from test_explore import page as page  # noqa: PLC0414


def test_a_header_that_lets_in_is_given_once(explored: Explored) -> None:
    """Two of them could be read as either."""
    own, token = f"127.0.0.1:{explored.port}", explored.token
    given = {"Host": own, "Origin": f"http://{own}", "X-Token": token, "Content-Type": "application/json", "Content-Length": "31"}
    body = '{"case": null, "values": {}   }'

    def asked(*further: tuple[str, str]) -> bytes:
        head = "".join(f"{name}: {value}\r\n" for name, value in [*given.items(), *further])
        return raw(explored, f"POST /set HTTP/1.1\r\n{head}\r\n{body}".encode())

    # Without a name it isn't written, but it is let in.
    assert asked().startswith(b"HTTP/1.1 422")
    for name, value in [*given.items(), ("Origin", "http://evil.example"), ("Host", "evil.example"), ("Content-Length", "2")]:
        answer = asked((name, value))
        assert answer.startswith(b"HTTP/1.1 400") and name.lower().encode() in answer, answer
    twice = raw(explored, f"GET /loop?token={token}&token={token} HTTP/1.1\r\nHost: {own}\r\n\r\n".encode())
    assert twice.startswith(b"HTTP/1.1 403")


def raw(explored: Explored, bytes_: bytes) -> bytes:
    """What the server answers to these bytes."""
    with socket.create_connection((explored.host, explored.port), timeout=30) as connection:
        connection.sendall(bytes_)
        with contextlib.suppress(ConnectionResetError):
            return b"".join(iter(lambda: connection.recv(65536), b""))
    return b""


def test_idle_connections_keep_nobody_out(explored: Explored) -> None:
    """Nor those that say a little again and again, or show another token."""
    idle = [socket.create_connection((explored.host, explored.port), timeout=30) for _ in range(200)]
    try:
        for k, connection in enumerate(idle):
            with contextlib.suppress(OSError):
                connection.sendall([b"", b"GET /loop HT", f"GET /loop HTTP/1.1\r\nHost: 127.0.0.1:{explored.port}\r\n".encode()][k % 3])
        begun = time.monotonic()
        for _ in range(3):
            assert explored.ask("GET", "/loop")[0] == 200
        assert time.monotonic() - begun < 3
        # Who waits is ended by a deadline, however often a byte comes.
        slow, begun = idle[197], time.monotonic()
        slow.settimeout(0.5)
        answer, asked = b"", b"HTTP/1.1 408"
        while len(answer) < len(asked) and time.monotonic() - begun < 20:
            with contextlib.suppress(OSError):
                slow.sendall(b"X")
            with contextlib.suppress(TimeoutError):
                answer += slow.recv(65536)
        assert answer.startswith(asked) and 5 < time.monotonic() - begun < 15
    finally:
        for connection in idle:
            connection.close()


OPENER = """#!/bin/sh
ps -ef -ww > "$SEEN/processes"
printf '%s' "$1" > "$SEEN/argument"
cp -p "$1" "$SEEN/page.html"
ls -ld "$(dirname "$1")" > "$SEEN/folder"
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the opener is xdg-open")
def test_the_token_is_not_in_the_list_of_processes(tmp_path: Path) -> None:
    opener, seen = tmp_path / "bin" / "xdg-open", tmp_path / "seen"
    opener.parent.mkdir()
    seen.mkdir()
    opener.write_text(OPENER)
    opener.chmod(0o755)
    around = {"PATH": f"{opener.parent}:{os.environ['PATH']}", "SEEN": str(seen), "TMPDIR": str(tmp_path)}
    done = adaptive_fmu("explore", LOOP, "--open", "--for", "1", folder=tmp_path, **around)
    assert done.returncode == 0 and "could not open" not in done.stderr, done
    url = done.stdout.strip()
    (token,) = parse_qs(urlsplit(url).query)["token"]
    # The file leads there; it and its folder are for their user alone, and gone when the page is.
    page, argument = seen / "page.html", Path((seen / "argument").read_text())
    assert token not in (seen / "processes").read_text() and "xdg-open" in (seen / "processes").read_text()
    assert f'content="0; url={url}"' in page.read_text() and page.stat().st_mode & 0o777 == 0o600
    assert (seen / "folder").read_text().startswith("drwx------")
    assert not argument.exists() and not argument.parent.exists()


def test_what_is_there_is_replaced_where_that_is_asked_for(tmp_path: Path) -> None:
    served = Explored(tmp_path, LOOP, "--until", "1")
    try:
        for path, name in [("/save", "mine.ssv"), ("/export", "mine")]:
            place = tmp_path / f"{LOOP}-explored" / name
            assert served.wanted(path, name="mine", values={AMPLITUDE: 1.25})[0] == 200
            file = place if place.is_file() else place / "ReferenceNonlinearSiso.fmu"
            before = file.read_bytes()
            status, answer = served.wanted(path, name="mine", values={AMPLITUDE: 1.5})
            assert status == 200 and answer["isThere"] and answer["error"].endswith(f"{name} already exists") and file.read_bytes() == before
            assert served.wanted(path, name="mine", values={AMPLITUDE: 1.5}, replace=True)[0] == 200
            assert file.read_bytes() != before
    finally:
        served.process.kill()


def test_the_page_asks_before_it_replaces_a_set(page: Callable[..., Any], explored: Explored) -> None:
    shown, file = page(f"#{AMPLITUDE}=1.5"), explored.out / f"{LOOP}-explored" / "asked.ssv"
    shown.locator("#name").fill("asked")
    shown.locator("#save").click()
    shown.get_by_text("Saved:").wait_for()
    before, number = file.read_text(), ran(shown)
    slider(shown, AMPLITUDE).locator("input[type=number]").fill("1.75")
    slider(shown, AMPLITUDE).locator("input[type=number]").press("Enter")
    ran(shown, number)
    shown.locator("#save").click()
    shown.get_by_text("already exists").wait_for()
    assert file.read_text() == before
    # What was shown when it was asked for is what is saved.
    shown.locator("#name").fill("other")
    shown.get_by_role("button", name="Replace").click()
    shown.get_by_text("Saved:").wait_for()
    assert "1.75" in file.read_text() and not file.with_name("other.ssv").exists()
