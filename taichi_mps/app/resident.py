"""A child process that stays and answers requests, one after the other: lines of JSON on its stdin and stdout."""

import asyncio
import json
import os
import queue
import sys
import threading
from asyncio.subprocess import DEVNULL, PIPE
from contextlib import suppress
from itertools import chain, count

IDLE = 600.0  # [s] without a request after which it ends
PATIENCE = 3.0  # [s] for it to end by itself
LONGEST = 2**24  # bytes of an answer
AGAIN = "The process of the previews had ended; it was started again."
TWICE = "The process of the previews ends each time it is asked for this."


class Resident:
    """The process of a module of this room, on the side of the server. It is started when it is first asked, again when
    it has died, and ends after ``idle`` [s] without a request, or when the server is gone, whatever ended that."""

    def __init__(self, module: str, idle: float = IDLE):
        self.module, self.idle, self.process = module, idle, None
        self.turn, self.open = asyncio.Lock(), 0  # requests whose last answer has not come: who waits has the turn

    async def ask(self, request: dict, patience: float | None = None):
        """Yield the answers to a request, the last one with ``end``. Who stops to listen cancels it. TimeoutError where
        one takes longer than ``patience`` [s], whereupon the process is ended."""
        async with self.turn:
            for _ in range(2):
                if not self.alive:
                    words = sys.executable, "-m", f"taichi_mps.app.{self.module}"
                    self.process = await asyncio.create_subprocess_exec(
                        *words, stdin=PIPE, stdout=PIPE, stderr=DEVNULL, limit=LONGEST, start_new_session=True
                    )
                    self.open = 0
                self.open += 1
                self.send({"idle": self.idle, **request})
                try:
                    while line := await asyncio.wait_for(self.process.stdout.readline(), patience):
                        answer, late = json.loads(line), self.open > 1  # to one that was cancelled
                        self.open -= "end" in answer
                        if not late:
                            yield answer
                        if not self.open:
                            return
                except (asyncio.TimeoutError, TimeoutError):
                    self.kill()
                    await self.process.wait()
                    raise TimeoutError from None
                finally:
                    if self.open:
                        self.send({})
                await self.process.wait()
                yield {"remark": AGAIN}
        yield {"wrong": TWICE, "end": True}

    @property
    def alive(self) -> bool:
        """Whether there is a process that can be asked."""
        return bool(self.process and self.process.returncode is None)

    def send(self, message: dict) -> None:
        """Write a line to the process, if there is one; an empty message cancels the request before it."""
        if self.alive:
            self.process.stdin.write(json.dumps(message).encode() + b"\n")

    async def close(self) -> None:
        """End it, at once if it does not by itself."""
        if self.alive:
            self.process.stdin.close()
            await asyncio.wait([asyncio.create_task(self.process.wait())], timeout=PATIENCE)
            self.kill()

    def kill(self) -> None:
        """End it at once."""
        if self.alive:
            with suppress(ProcessLookupError):
                self.process.kill()


def answer_all(answer) -> None:
    """In the process: answer each request by ``answer(request, tell, cancelled)``, where ``tell`` sends a part of the
    answer and ``cancelled()`` is whether nobody waits for it any more, until stdin is closed or nobody asks. Whatever
    comes after a request cancels it."""
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what is printed meanwhile is no answer
    came, lines, idle = [], queue.SimpleQueue(), None

    def read():
        for line in chain(sys.stdin, [""]):
            came.append(line)
            lines.put(line)

    def tell(**part):
        out.write(json.dumps(part) + "\n")
        out.flush()

    threading.Thread(target=read, daemon=True).start()
    for taken in count(1):
        try:
            request = json.loads(lines.get(timeout=idle) or "null")
        except queue.Empty:
            os._exit(0)  # the thread that reads would hold up any other end
        if request is None:
            return
        if request:
            idle = request.pop("idle")
            try:
                answer(request, tell, lambda taken=taken: len(came) > taken)
            except Exception as error:  # a request of the page ends no process
                tell(wrong=f"{type(error).__name__}: {error}")
            tell(end=True)
