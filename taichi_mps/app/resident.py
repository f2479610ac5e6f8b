"""A child process that stays and answers requests, one after the other: lines of JSON on its stdin and stdout."""

import asyncio
import json
import os
import queue
import sys
import threading
from asyncio.subprocess import DEVNULL, PIPE
from contextlib import suppress
from itertools import count

IDLE = 600.0  # [s] without a request after which it ends
PATIENCE = 3.0  # [s] for it to end by itself
LONGEST = 2**24  # bytes of an answer
AGAIN = "The process of the previews had ended; it was started again."
TWICE = "The process of the previews ends each time it is asked for this."


class Resident:
    """The process of a module of this room, on the side of the server. It is started when it is first asked, again when
    it has died, and ends after ``idle`` [s] without a request, or when the server is gone, whatever ended that."""

    def __init__(self, module: str, idle: float = IDLE):
        self.module, self.idle, self.numbers = module, idle, count(1)
        self.process, self.reader, self.timer = None, None, None
        self.waiting: dict[int, asyncio.Queue] = {}  # for answers, by the number of the request; None: it has died
        self.starting = asyncio.Lock()

    async def ask(self, request: dict, patience: float | None = None):
        """Yield the answers to a request, the last one with ``end``. Who stops to listen cancels it. TimeoutError where
        one takes longer than ``patience`` [s], whereupon the process is ended."""
        for _ in range(2):
            number, answers = next(self.numbers), asyncio.Queue()
            try:
                await self.start()
                self.waiting[number] = answers
                self.send({"id": number, **request})
                while (answer := await asyncio.wait_for(answers.get(), patience)) is not None:
                    yield answer
                    if answer.get("end"):
                        return
            except (asyncio.TimeoutError, TimeoutError):
                self.kill()
                raise TimeoutError from None
            finally:
                if self.waiting.pop(number, None):
                    self.send({"cancel": number})
            yield {"remark": AGAIN}
        yield {"wrong": TWICE, "end": True}

    async def start(self) -> None:
        """Make the process, if there is none, and put off its end."""
        async with self.starting:
            if not self.alive:
                words = sys.executable, "-m", f"taichi_mps.app.{self.module}"
                self.process = await asyncio.create_subprocess_exec(
                    *words, stdin=PIPE, stdout=PIPE, stderr=DEVNULL, limit=LONGEST, start_new_session=True
                )
                self.reader = asyncio.create_task(self.read(self.process))
        if self.timer:
            self.timer.cancel()
        self.timer = asyncio.get_running_loop().call_later(self.idle, self.end)

    @property
    def alive(self) -> bool:
        """Whether there is a process that can be asked."""
        return bool(self.process and self.process.returncode is None and not self.process.stdin.is_closing())

    def send(self, message: dict) -> None:
        """Write a line to the process, if there is one."""
        if self.alive:
            self.process.stdin.write(json.dumps(message).encode() + b"\n")

    async def read(self, process) -> None:
        """Hand answers to who waits for them, until the process has ended."""
        with suppress(ValueError):  # a line that is too long
            async for line in process.stdout:
                answer = json.loads(line)
                if answers := self.waiting.get(answer.pop("id")):
                    answers.put_nowait(answer)
        await process.wait()
        if process is self.process:
            for answers in self.waiting.values():
                answers.put_nowait(None)

    def end(self) -> None:
        """Let it end by itself."""
        if self.alive:
            self.process.stdin.close()

    async def close(self) -> None:
        """End it, at once if it does not by itself."""
        self.end()
        if self.timer:
            self.timer.cancel()
        if self.reader:
            await asyncio.wait([self.reader], timeout=PATIENCE)
            self.kill()

    def kill(self) -> None:
        """End it at once."""
        if self.process and self.process.returncode is None:
            with suppress(ProcessLookupError):
                self.process.kill()


def answer_all(answer) -> None:
    """In the process: answer each request by ``answer(request, tell, cancelled)``, where ``tell`` sends a part of the
    answer and ``cancelled()`` is whether nobody waits for it any more, until stdin is closed."""
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what is printed meanwhile is no answer
    asked, gone, closed = queue.SimpleQueue(), set(), threading.Event()

    def read():
        for line in sys.stdin:
            message = json.loads(line)
            gone.add(message["cancel"]) if "cancel" in message else asked.put(message)
        closed.set()
        asked.put(None)

    threading.Thread(target=read, daemon=True).start()
    while (request := asked.get()) is not None:
        number = request.pop("id")

        def tell(number=number, **part):
            out.write(json.dumps({"id": number, **part}) + "\n")
            out.flush()

        def cancelled(number=number):
            return number in gone or closed.is_set()

        if not cancelled():
            try:
                answer(request, tell, cancelled)
            except Exception as error:  # a request of the page ends no process
                tell(wrong=f"{type(error).__name__}: {error}")
            tell(end=True)
        gone.discard(number)
