"""A user's own Python file in this process: each load is a new one, errors have their line."""

from __future__ import annotations

import inspect
import signal
import sys
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, TracebackType

from vsense.base.arena import POSE
from vsense.base.errors import CutShort, NeverReturned, VsenseError, likely
from vsense.base.files import read_bytes
from vsense.base.interruption import ALARM_S, STUCK_S, OpenCall, calls, code, open_call

_MAX_SHOWN = 300


class UsersCode:
    """One Python file of a user; `file` is its name in errors.

    `ran` is whether this process has run any.
    """

    ran = False

    def __init__(self, path: Path, error: Callable[[str, int, str], VsenseError]) -> None:
        """Modules beside the file at `path` may be imported in it.

        `error` makes what is raised from file, line (from 1) and what happened there.
        """
        self.file = str(path)
        self._path = path
        self._folder = str(path.resolve().parent)
        self._error, self._module = error, ""

    def error(self, line: int, message: str) -> VsenseError:
        """Makes the error that something is wrong in a line of the file."""
        return self._error(self.file, line, message)

    def load(self, name: str) -> ModuleType:
        """Runs the file as a new module `name`: a second run does not find the first one's.

        Raises:
            VsenseError: the user's, made by `error`: it cannot be read, or it failed.
        """
        try:
            source = read_bytes(self._path)
        except OSError as error:
            reason = error.strerror or type(error).__name__
            raise self.error(1, f"cannot be read: {reason}") from None
        module, self._module = ModuleType(name), name
        module.__file__ = self.file
        UsersCode.ran, before = True, set(sys.modules)
        # Dataclasses look the module that they are made in up by its name.
        sys.modules[name] = module
        with self.watch():
            exec(compile(source, self.file, "exec", dont_inherit=True), module.__dict__)
        for other in set(sys.modules) - before - {name}:
            # Of a package of the same name in another folder nothing shall be found here.
            module_path = Path(self._folder, *other.split("."))
            file = getattr(sys.modules[other], "__file__", None) or ""
            if file in (f"{module_path}.py", str(module_path / "__init__.py")):
                del sys.modules[other]
        return module

    def refuse_misspelt(self, holder: object, known: Collection[str], what: str) -> None:
        """Refuses a function of the file that looks like a known one and is none.

        Args:
            holder: module, class or object that has the functions.
            known: names of functions that are called.
            what: says of any other that it is none of them.

        Raises:
            VsenseError: the user's, made by `error`.
        """
        missing = [name for name in known if getattr(holder, name, None) is None]
        for name, routine in inspect.getmembers(holder, inspect.isroutine):
            is_own = getattr(routine, "__module__", "") == self._module
            is_other = is_own and not name.startswith("_") and name not in known
            if is_other and (hint := likely(name, missing)):
                words = f"{name} {what}{hint}; begin its name with _ if it is your own"
                raise self.error(line_of(routine), words)

    @contextmanager
    def watch(
        self, where: str = "", fallback: int = 1, through: tuple[type[Exception], ...] = ()
    ) -> Iterator[None]:
        """Runs the user's code: modules beside it are found, and its errors have their line.

        SystemExit is an error here, too: a file must not end the program. Ctrl-C goes through,
        unless it ends a call that has not returned for long.

        Args:
            where: begins the error's message.
            fallback: line of an error that came from none of the file's.
            through: errors that have a better place of their own.

        Raises:
            VsenseError: the user's, made by `error`.
        """
        with self.beside(), open_call(self.file, self.file, STUCK_S) as call:
            try:
                yield
            except BaseException as error:
                if call.alarms:
                    words = f"{where}it had not returned for {call.duration_s:.1f} s and was ended"
                    text = str(self.error(_line_in(self.file, error) or fallback, words))
                    raise NeverReturned(text, code()) from None
                if _is_signal(error) or isinstance(error, through):
                    raise
                raise self.caused(error, where, fallback) from error

    def caused(self, error: BaseException, where: str = "", fallback: int = 1) -> VsenseError:
        """Makes the error that says what an exception of the user's code means; see `watch`."""
        return self.error(_line_in(self.file, error) or fallback, where + _words(error))

    @contextmanager
    def beside(self) -> Iterator[None]:
        """Modules beside the file may be imported."""
        sys.path.append(self._folder)
        try:
            yield
        finally:
            ours = [place for place, folder in enumerate(sys.path) if folder == self._folder]
            for last in ours[-1:]:
                del sys.path[last]


def _is_signal(error: BaseException) -> bool:
    """Whether it is Ctrl-C, or ends the command, and not the user's own code."""
    by_python = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    return isinstance(error, CutShort) or (by_python and isinstance(error, KeyboardInterrupt))


class CallWatchdog:
    """Says which users' code does not return, and where it is; a context with a thread."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="vsense-watchdog", daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *exception: object) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        told: list[OpenCall] = []
        while not self._over.wait(ALARM_S):
            now = [call for call in calls if call.duration_s > STUCK_S and call.limit_s == STUCK_S]
            for call in told:
                if call not in now:
                    self._say(f"{call.name} has returned")
            for call in now:
                if call not in told:
                    frame = call.found_in(sys._current_frames().get(call.thread))
                    place = call.name if frame is None else f"{call.name}:{frame.f_lineno}"
                    since = f"has not returned for {call.duration_s:.1f} s"
                    self._say(f"{place}: it {since}: robots stand until it does")
            told = now


def line_of(function: object) -> int:
    """The line that a function begins in, 1 where it is none."""
    plain = inspect.unwrap(function) if callable(function) else function
    code = getattr(plain, "__code__", None)
    return code.co_firstlineno if code is not None else 1


def _line_in(file: str, error: BaseException) -> int | None:
    """The line of a file that an error came from, or came through last."""
    if isinstance(error, SyntaxError) and error.filename == file and error.lineno:
        return error.lineno
    line, step = None, error.__traceback__
    while isinstance(step, TracebackType):
        if step.tb_frame.f_code.co_filename == file:
            line = step.tb_lineno
        step = step.tb_next
    return line


def _words(error: BaseException) -> str:
    """What happened, in one line; an error of our own says enough by itself."""
    try:
        text = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
    except Exception:  # the user's own class may fail at this, too
        text = "it cannot say what is wrong"
    if isinstance(error, VsenseError):
        return text[:_MAX_SHOWN]
    if text.startswith("no field of name"):  # NumPy's words
        text += f"; world.robots has {', '.join(POSE.names or ())}"
    name = type(error).__name__
    return f"{name}: {text}"[:_MAX_SHOWN] if text else name
