"""A child process that stays and answers requests, one after the other."""

import asyncio
import multiprocessing
import os
import signal
import threading
from contextlib import suppress
from importlib import import_module

IDLE = 600.0  # [s] without a request after which it ends
PATIENCE = 3.0  # [s] for it to end by itself
CANCEL, END = "cancel", "end"  # what it is told besides requests
AGAIN = "The process of the previews had ended; it was started again."
TWICE = "The process of the previews ends each time it is asked for this."


class Resident:
    """The process of a module of this room, on the side of the server. It is started when it is first asked, again when
    it has died, and ends after ``idle`` [s] without a request, or when the server is gone, whatever ended that."""

    def __init__(self, module: str, idle: float = IDLE):
        self.module, self.idle, self.turn = module, idle, asyncio.Lock()
        self.process, self.owed = None, 0  # answers that are under way

    async def ask(self, request: dict, patience: float | None = None):
        """Yield the answers to a request, the last one with ``end``. Who stops to listen cancels it. TimeoutError where
        one takes longer than ``patience`` [s], whereupon the process is ended."""
        async with self.turn:
            for _ in range(2):
                try:
                    self.start()
                    self.connection.send(request)
                    self.owed += 1
                    while part := await asyncio.wait_for(self.parts.get(), patience):
                        ours = self.owed == 1  # and not of a request that was cancelled
                        self.owed -= "end" in part
                        if ours:
                            yield part
                        if not self.owed:
                            return
                except (asyncio.TimeoutError, TimeoutError):
                    self.kill()
                    raise TimeoutError from None
                except ConnectionError:  # it ended just now
                    pass
                finally:
                    if self.owed:
                        self.send(CANCEL)
                self.kill()
                yield {"remark": AGAIN}
            yield {"wrong": TWICE, "end": True}

    def start(self) -> None:
        """Make the process, if there is none."""
        if not self.alive:
            context, self.parts, self.owed = multiprocessing.get_context("spawn"), asyncio.Queue(), 0
            self.connection, theirs = context.Pipe()
            self.process = context.Process(target=answer_all, args=(self.module, self.idle, theirs), daemon=True)
            self.process.start()
            theirs.close()
            hand_over = self.connection, self.parts, asyncio.get_running_loop()
            threading.Thread(target=read, args=hand_over, daemon=True).start()

    @property
    def alive(self) -> bool:
        """Whether there is a process that can be asked."""
        return bool(self.process and self.process.is_alive())

    def send(self, message) -> None:
        """Tell the process something, if there is one."""
        with suppress(OSError):
            self.connection.send(message)

    async def close(self) -> None:
        """End it, at once if it does not by itself."""
        if self.process:
            self.send(END)
            await asyncio.to_thread(self.process.join, PATIENCE)
            self.kill()

    def kill(self) -> None:
        """End it at once."""
        if self.process:
            self.process.kill()
            self.process.join()


def read(connection, parts: asyncio.Queue, loop) -> None:
    """Hand the answers of a process over to the loop of the server; None when it has ended."""
    part = True
    with suppress(RuntimeError):  # the loop is closed
        while part:
            try:
                part = connection.recv()
            except (EOFError, OSError):
                part = None
            loop.call_soon_threadsafe(parts.put_nowait, part)


def answer_all(module: str, idle: float, connection) -> None:
    """In the process: answer each request by ``answer(request, tell, cancelled)`` of the module, where ``tell`` sends a
    part of the answer and ``cancelled()`` is whether nobody waits for it any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the server's to answer
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nothing, stream)
    answer = import_module(f"{__package__}.{module}").answer

    def tell(**part):
        connection.send(part)

    with suppress(EOFError, OSError):  # the server is gone
        while connection.poll(idle) and (request := connection.recv()) != END:
            if request == CANCEL:  # of what had ended just before
                continue
            try:
                answer(request, tell, connection.poll)
            except Exception as error:  # a request of the page ends no process
                tell(wrong=f"{type(error).__name__}: {error}")
            tell(end=True)
