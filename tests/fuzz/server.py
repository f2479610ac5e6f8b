"""Random requests and questions to the server of the page: it keeps running, answers, and discloses no file."""

import json
import random
import re
import socket
import subprocess
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

from tests.support.served import serving

ANSWERS = 60.0  # [s] for one answer, on a busy machine
GREW = 400e6  # [bytes] by which the server may grow meanwhile
SECRET = "secret-of-somebody"  # in a file beside the runs, and in one of a run that is not shown
PARTS = ["", "/", "..", ".", "%2e%2e", "..%2f", "%00", "%ff", "\\", "a" * 3000, "~", "*", "{}", "\x7f", "?", ";", "é"]
NAMES = ["secret.json", "checkpoint.h5", "summary.json", "report.html", "frames/frame_00000.png", "history.csv", "link"]
PATHS = ["/", "/runs/run/{}", "/runs/{}", "/report/{}", "/static/{}", "/ask/{}", "/{}", "/docs"]
FOREIGN = {
    "Host": ["evil.example", "", "127.0.0.1", "localhost:1", "127.0.0.1.evil.example:{port}"],
    "Origin": ["null", "http://evil.example", "https://127.0.0.1:{port}", "http://127.0.0.1:{port}@evil.example"],
    "Sec-Fetch-Site": ["cross-site", "same-site", "", "none, cross-site"],
}
ODD = {
    "Accept-Encoding": ["gzip", "\xff", "*" * 5000],
    "Range": ["bytes=0-", "bytes=-1", "bytes=9-1", "bytes=0-0,1-1,2-2", "b" * 999, "bytes=" + "0-1," * 500],
    "Cookie": ["session=" + "A" * 4000, "a=b; a=c", "\x01"],
    "Content-Length": ["-1", "10", "abc", "99999999999"],
    "Transfer-Encoding": ["chunked", "gzip, chunked"],
    "X-Forwarded-Prefix": ["/evil", '"><script>'],
    "If-Modified-Since": ["yesterday", "0"],
}
METHODS = ["GET"] * 6 + ["HEAD", "POST", "PUT", "OPTIONS", "get", "TRACE", "G\xcbT", ""]
TEXTS = [
    "300",
    "0,3 kPa",
    "-1",
    "nan",
    "1e400",
    "1,000",
    "",
    " ",
    "é\u202e",
    "\x00",
    "9" * 5000,
    "<b>x</b>",
    "5 mm",
    "Slump",
]
VALUES = [None, True, -1, 1e300, [], [1, 2], {}, {"value": "x"}, "full", "../run", "link", float("nan")]
QUESTIONS = [
    "tests",
    "forecast",
    "calibrate",
    "found",
    "jobs",
    "stop",
    "list",
    "show",
    "compare",
    "draw",
    "resume",
    "rename",
    "delete",
    "restore",
    "empty",
    "preview",
    "serve",
    "__init__",
]
KEYS = ["test", "values", "names", "to", "job", "check", "more"]
FIELDS = ["yield_value", "spacing", "model", "slump", "spread", "scheme", "out", "threads", ""]


def request(port: int, dice: random.Random) -> tuple[bytes, bool]:
    """A request, and whether it says that it comes from elsewhere."""
    path = dice.choice(PATHS)
    if "{}" in path:
        path = path.format("/".join(dice.choice([*PARTS, *NAMES]) for _ in range(dice.randint(1, 3))))
    headers, foreign = {"Host": f"127.0.0.1:{port}", "Connection": "close"}, dice.random() < 0.4
    if foreign:
        name = dice.choice(list(FOREIGN))
        headers[name] = dice.choice(FOREIGN[name]).format(port=port)
    for name in dice.sample(list(ODD), dice.choice([0, 0, 1, 2])):
        headers[name] = dice.choice(ODD[name])
    path = path if dice.random() < 0.2 else quote(path, safe="/?=&%.*~;")
    lines = [f"{dice.choice(METHODS)} {path} HTTP/1.1", *(f"{name}: {text}" for name, text in headers.items())]
    data = "\r\n".join([*lines, "", ""]).encode("utf-8", "surrogateescape")
    if dice.random() < 0.05:
        k = dice.randrange(len(data))
        data, foreign = data[:k] + dice.randbytes(dice.randint(1, 50)) + data[k + 1 : -1], False
    return data, foreign


def answer(port: int, data: bytes, whole=True) -> bytes:
    """What the server says to these bytes, at most 10 MB of it; it would wait for the rest of what is not whole."""
    said = b""
    with socket.create_connection(("127.0.0.1", port), ANSWERS) as line, suppress(ConnectionError):
        line.sendall(data)
        if not whole:
            line.shutdown(socket.SHUT_WR)
        while len(said) < 10_000_000 and (piece := line.recv(65536)):
            said += piece
    return said


def wrong_answer(port: int, dice: random.Random) -> str | None:
    """A request that is answered as it must not be; None where none is."""
    data, foreign = request(port, dice)
    try:
        said = answer(
            port, data, whole=not re.search(rb"Content-Length|Transfer-Enc", data) and data.endswith(b"\r\n\r\n")
        )
    except TimeoutError:
        return f"{data[:300]!r}: no answer in {ANSWERS:g} s"
    code = said[9:12].decode("latin-1")
    if code.startswith("5"):
        return f"{data[:300]!r}: {said[:200]!r}"
    if foreign and code[:1] in ("1", "2", "3"):
        return f"{data[:300]!r} from elsewhere: {code}"
    return f"{data[:300]!r}: gives {SECRET}" if SECRET.encode() in said else None


def question(dice: random.Random) -> bytes:
    """What a page might ask, in parts what none asks."""
    if dice.random() < 0.1:
        return dice.choice([b"[", b"[" * 5000, b"\xff", b"{}" * 3, b"1e999", b'{"job":1' + b"0" * 5000 + b"}"])
    asked = {key: dice.choice([*TEXTS, *VALUES]) for key in dice.sample(KEYS, dice.randint(0, 2))}
    if dice.random() < 0.6:
        asked["values"] = {key: dice.choice(TEXTS) for key in dice.sample(FIELDS, dice.randint(1, 3))}
    if dice.random() < 0.4:
        asked["names"] = dice.sample([*PARTS, "run", "link", "secret.json"], dice.randint(1, 3))
    return json.dumps(asked).encode()


def questions(port: int, dice: random.Random, number=60) -> str | None:
    """What is wrong with the answers to questions of a tab."""
    for _ in range(number):
        what, body = dice.choice(QUESTIONS), question(dice)
        head = f"POST /ask/{what} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n"
        head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
        said = answer(port, head.encode() + body)
        if said[9:12] not in (b"200", b"404", b"413") or SECRET.encode() in said:
            return f"{what} {body[:300]!r}: {said[:200]!r}"
    return None


def memory(process: int) -> float:
    """Memory of a process [bytes], by Linux."""
    return 1024.0 * int(re.search(r"VmRSS:\s*(\d+)", Path(f"/proc/{process}/status").read_text())[1])


def attack(folder: Path, bases, dice: random.Random, requests=300) -> str | None:
    """What is wrong with the server of a folder of runs, after requests and a tab; None where nothing is."""
    (folder / "run" / "frames").mkdir(parents=True)
    for name in ("taichi_mps.json", "summary.json", "checkpoint.h5", "report.html", "frames/frame_00000.png"):
        text = SECRET if name == "checkpoint.h5" else json.dumps({"made_by": "taichi_mps", "n": dice.choice([1, []])})
        (folder / "run" / name).write_text(text)
    (folder / "secret.json").write_text(SECRET)
    (folder / "run" / "history.csv").symlink_to(folder / "secret.json")
    (folder / dice.choice(["base", "b%41se", "ü", "a b"])).symlink_to(dice.choice(bases))
    try:
        with serving(folder, quiet=False) as (port, server):
            before = memory(server.pid)
            for ask in (*[wrong_answer] * requests, questions):
                if wrong := ask(port, dice):
                    return wrong
            home = f"GET / HTTP/1.1\r\nHost: localhost:{port}\r\nConnection: close\r\n\r\n".encode()
            assert answer(port, home).startswith(b"HTTP/1.1 200"), "the page is not answered any more"
            assert memory(server.pid) - before < GREW, "it grows"
    except (AssertionError, OSError, subprocess.TimeoutExpired) as error:
        return f"{type(error).__name__}: {error}"
    return None
