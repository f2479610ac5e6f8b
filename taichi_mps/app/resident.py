"""Resident child process that answers requests, one after the other, by lines of JSON on its stdin and stdout."""

import asyncio
import json
import os
import queue
import subprocess
import sys
import threading
from asyncio.subprocess import PIPE
from contextlib import suppress
from itertools import chain, count
from tempfile import TemporaryFile

IDLE_TIMEOUT = 600.0  # time without a request after which the process ends [s]
EXIT_TIMEOUT = 3.0  # time for the process to end by itself [s]
MAX_LINE_BYTES = 2**24  # of an answer
# of a child: Ctrl-C in the terminal of the server does not reach it. Windows has groups of processes for sessions
OWN_SESSION = {"start_new_session": True, "creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
RESTARTED = "The process of the previews had ended; it was started again."


class Resident:
    """Resident process that answers requests of one kind, a key of ``worker.ANSWERS``, on the side of the server. It is
    started by the first request, again if it has died, and ends after ``idle`` [s] without a request, or with the
    server."""

    def __init__(self, kind: str, idle: float = IDLE_TIMEOUT):
        self.kind, self.idle, self.process = kind, idle, None
        self.lock, self.unanswered = asyncio.Lock(), 0  # requests without their last answer

    async def ask(self, request: dict, timeout: float | None = None):
        """Yield the answers to a request, the last one with ``end``; a closed generator cancels it. TimeoutError if an
        answer takes longer than ``timeout`` [s], after which the process is killed."""
        async with self.lock:
            for _ in range(2):
                if not self.alive:
                    self.messages = TemporaryFile()  # noqa: SIM115 - open as long as the process
                    self.process = await asyncio.create_subprocess_exec(
                        *(sys.executable, "-m", "taichi_mps.app.worker", self.kind),
                        stdin=PIPE,
                        stdout=PIPE,
                        stderr=self.messages,
                        limit=MAX_LINE_BYTES,
                        **OWN_SESSION,
                    )
                    self.unanswered = 0
                self.unanswered += 1
                self.send({"idle": self.idle, **request})
                try:
                    while line := await asyncio.wait_for(self.process.stdout.readline(), timeout):
                        answer, cancelled = json.loads(line), self.unanswered > 1
                        self.unanswered -= "end" in answer
                        if not cancelled:
                            yield answer
                        if not self.unanswered:
                            return
                except (asyncio.TimeoutError, TimeoutError):
                    self.kill()
                    await self.process.wait()
                    raise TimeoutError from None
                finally:
                    if self.unanswered:
                        self.send({})
                await self.process.wait()
                yield {"remark": RESTARTED}
        self.messages.seek(0)
        last = self.messages.read().decode("utf-8", "replace").rstrip().rpartition("\n")[2] or "it was killed"
        yield {"wrong": f"The process of the previews ends each time it is asked for this: {last}", "end": True}

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return bool(self.process and self.process.returncode is None)

    def send(self, message: dict) -> None:
        """Write a line to the process, if there is one; an empty message cancels the request before it."""
        if self.alive:
            self.process.stdin.write(json.dumps(message).encode() + b"\n")

    async def close(self) -> None:
        """End the process, and kill it if it does not end by itself."""
        if self.alive:
            self.process.stdin.close()
            await asyncio.wait([asyncio.create_task(self.process.wait())], timeout=EXIT_TIMEOUT)
            self.kill()

    def kill(self) -> None:
        """Kill the process."""
        if self.alive:
            with suppress(ProcessLookupError):
                self.process.kill()


def answer_all(answer) -> None:
    """Loop of the resident process: answer each request by ``answer(request, tell, cancelled)``, where ``tell`` sends a
    part of the answer and ``cancelled()`` is whether the request was cancelled, until stdin is closed or no request
    comes in time. Any line after a request cancels it."""
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # other output goes to stderr
    received, lines, idle = [], queue.SimpleQueue(), None

    def read():
        for line in chain(sys.stdin, [""]):
            received.append(line)
            lines.put(line)

    def tell(**part):
        out.write(json.dumps(part) + "\n")
        out.flush()

    threading.Thread(target=read, daemon=True).start()
    for number in count(1):
        try:
            request = json.loads(lines.get(timeout=idle) or "null")
        except queue.Empty:
            os._exit(0)  # the thread that reads would hold up any other end
        if request is None:
            return
        if request:
            idle = request.pop("idle")
            try:
                answer(request, tell, lambda number=number: len(received) > number)
            except Exception as error:  # a request of the page ends no process
                tell(wrong=f"{type(error).__name__}: {error}")
            tell(end=True)
