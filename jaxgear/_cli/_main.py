"""The command line: reads the scene, refuses what cannot be, and hands over to the commands.

Standard output carries results only; everything else goes to standard error. Exit codes: 0
success, 2 a bad scene or an impossible gear, 1 a solver that failed, 130 interrupted. The
commands are imported only once the scene is known to be good.
"""

import _thread
import argparse
import gc
import io
import json
import os
import sys
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from jaxgear._checks import InputError
from jaxgear._cli._fit import refuse_unfit
from jaxgear._cli._folder import REPORT, Folder, begun, publish, written
from jaxgear._cli._init import write_first_scene, write_imported, write_measured
from jaxgear._cli._keys import explain_key, print_keys
from jaxgear._cli._parser import parser
from jaxgear._cli._plot import draw_again
from jaxgear._cli._printing import print_notes, print_results
from jaxgear._cli._terminal import Terminal, warn
from jaxgear._program_cache import set_up
from jaxgear._whole_file import write_text
from jaxgear.scene._scene import SceneError, read_scene
from jaxgear.scene._slips import odd

# Many threads make the many small matrices of a gear pair several times slower.
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
# How long Ctrl-C waits for an answer that the explorer is at [s].
_PATIENCE = 0.5


class _Stop(Exception):
    """A reason to stop that the user can act on, and the exit code."""

    def __init__(self, code: int, message: str):
        super().__init__(message)
        self.code = code


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command line and return its exit code.

    **Arguments:**

    - `argv`: the arguments; `sys.argv` without it.

    **Returns:**

    0 success, 2 a bad scene or an impossible gear, 1 a solver that failed, 130 interrupted.
    """
    for name in _THREADS:
        os.environ.setdefault(name, "1")
    # Python would look for garbage over and over through all that is imported and traced.
    gc.set_threshold(1_000_000, 50, 100)
    if sys.stdout is None:
        # Closed, as some services start their commands.
        sys.stdout = open(os.devnull, "w", encoding="utf-8")
    # What a terminal cannot show, such as the µ of µm, is no reason to lose results.
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        with _kept_interrupts():
            code = _command(argv)
        sys.stdout.flush()
        return code
    except (_Stop, SceneError) as error:
        print(f"jaxgear: {error}" if isinstance(error, _Stop) else error, file=sys.stderr)
        return error.code if isinstance(error, _Stop) else 2
    except KeyboardInterrupt:
        print("jaxgear: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader, such as `head`, has seen enough.
        _discard_output()
        return 0
    except OSError as error:
        _discard_output()
        print(f"jaxgear: cannot write to standard output: {error.strerror}", file=sys.stderr)
        return 1


def _discard_output() -> None:
    """Let what is left go nowhere: Python flushes once more at its exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def _kept_interrupts() -> Generator[None]:
    """Interrupt again where a library's callback, such as JAX's, has swallowed it."""
    usual = sys.unraisablehook

    def hook(lost: Any) -> None:
        if issubclass(lost.exc_type, KeyboardInterrupt):
            _thread.interrupt_main()
        else:
            usual(lost)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = usual


def _command(argv: Sequence[str] | None) -> int:
    """Carry out one command line and return its exit code."""
    try:
        args = parser().parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    _refuse_unspeakable(args)
    apart = {
        "init": _init,
        "keys": print_keys,
        "explain": lambda args: explain_key(args.key),
        "schema": _schema,
        "explore": _explore,
        "study": _designs,
        "import": _import,
        "export": _export,
        "plot": _plot,
        "report": _report,
        "cache": _cache,
        "doctor": _doctor,
    }
    try:
        return apart.get(args.command, _study)(args)
    except InputError as error:
        raise _Stop(2, str(error)) from None


def _study(args: argparse.Namespace) -> int:
    """Study a scene, and return the exit code."""
    scene = read_scene(args.scene, args.overrides)
    refuse_unfit(args.command, scene)
    for remark in odd(scene):
        warn(remark)
    with _results(args, scene.name, scene.path) as folder:
        with _failures(scene.path, folder.path):
            from jaxgear._cli import _commands

            with _numerical(args.quiet):
                summary = _commands.COMMANDS[args.command](scene, folder)
            publish(folder)
    wrong = summary["check_grad"]["verdicts"]["WRONG"] if "check_grad" in summary else 0
    if args.json:
        _print_json(summary)
    elif not args.quiet or "check_grad" in summary:
        print_results(args.command, summary)
    if not (args.json or args.quiet):
        print_notes(summary.get("notes", ()))
    if not args.quiet:
        print(f"results in {folder.path}", file=sys.stderr)
    if wrong:
        words = f"{wrong} derivatives disagree with central differences; they are marked WRONG in"
        raise _Stop(1, f"{words} {folder.path / 'gradients.csv'}.")
    return 0


def _refuse_unspeakable(args: argparse.Namespace) -> None:
    """Refuse bytes that are no text: they would come to light where results are written."""
    texts = [
        getattr(args, name, "") for name in ("scene", "study", "result", "results", "file", "out")
    ]
    for value in (*texts, *getattr(args, "overrides", ())):
        try:
            str(value).encode()
        except UnicodeEncodeError:
            told = str(value).encode(errors="backslashreplace").decode()
            raise _Stop(2, f"arguments must be text in UTF-8, got {told}") from None


@contextmanager
def _results(args: argparse.Namespace, name: str, scene: Path) -> Generator[Folder]:
    """The folder of a command on a named scene; refused if it cannot be written to."""
    common = args.out or Path("results") / name
    path = common if args.command == "run" else common / args.command
    own = path / "scene.toml"
    with ExitStack() as stack:
        try:
            if own.exists() and own.samefile(scene) and own.name not in written(path):
                words = "the results would replace the scene. Name another folder: --out DIR"
                raise _Stop(2, f"{own}: {words}")
            folder = stack.enter_context(begun(Folder(path, args.pictures, common=common)))
        except (OSError, ValueError) as error:
            # A name that the file system cannot spell is a ValueError.
            why = error.strerror if isinstance(error, OSError) else error
            words = f"cannot write results into {path}: {why}. Name another folder with --out DIR."
            raise _Stop(2, words) from None
        yield folder


@contextmanager
def _numerical(quiet: bool) -> Generator[None]:
    """Compute with 64-bit numbers, one BLAS thread, and programs that are kept."""
    import threadpoolctl

    set_up(warn)
    from jaxgear.study import listened_by, stopwatch

    # The environment is too late for a library that is loaded already; this is not.
    shown = nullcontext() if quiet else listened_by(Terminal())
    with threadpoolctl.threadpool_limits(1), shown, stopwatch():
        yield


@contextmanager
def _failures(scene: Path, results: Path) -> Generator[None]:
    """Say of what cannot be computed or written from which scene, or into which folder."""
    from jaxgear.study._statics import SolverFailure

    try:
        yield
    except (SolverFailure, FloatingPointError, InputError) as error:
        code = 2 if isinstance(error, InputError) else 1
        raise _Stop(code, f"{scene}: {error}") from error
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _Stop(1, f"cannot write results into {results}: {error}") from error


def _designs(args: argparse.Namespace) -> int:
    """Study many designs of a scene."""
    from jaxgear._cli import _designs

    with _numerical(args.quiet):
        from jaxgear.designs._engines import WorkerLost

        try:
            summary = _designs.studied(args)
        except WorkerLost as error:
            raise _Stop(1, f"{args.study}: {error}") from None
        except OSError as error:
            where = error.filename or args.out or "the folder of the study"
            words = f"cannot write {where}: {error.strerror}. What is finished is kept"
            raise _Stop(1, f"{words}: with more space the same command goes on.") from None
    if args.json:
        _print_json(summary)
    elif not args.quiet:
        print_results("study", summary)
        print_notes(summary.get("notes", ()))
    return 0


def _explore(args: argparse.Namespace) -> int:
    """Serve a scene to a browser on this computer, until interrupted."""
    scene = read_scene(args.scene, args.overrides)
    for remark in odd(scene):
        warn(remark)
    target = args.out or scene.path.with_name(f"{scene.path.stem}.explored.toml")
    with _numerical(quiet=False):
        from jaxgear.explore import Explorer
        from jaxgear.study import live_scene

        live = live_scene(scene)
        for key in args.keys:
            live = live.with_key(key)
        try:
            explorer = Explorer(live, target, args.port)
        except (OSError, OverflowError) as error:
            raise _Stop(2, f"cannot listen on port {args.port}: {error}. Name another.") from None
        print(f"{explorer.address}\nOpen this address in a browser; Ctrl-C ends it.", flush=True)
        with suppress(KeyboardInterrupt):
            explorer.serve()
        if not explorer.is_idle(_PATIENCE):
            # Python would take the process down under a program of JAX that still runs: it aborts.
            os._exit(0)
    return 0


def _cache(args: argparse.Namespace) -> int:
    """List what the cache holds, or remove it."""
    from jaxgear._cli._cache import cache_summary, cleared, print_cache

    found = cleared() if args.clear else cache_summary()
    if args.json:
        _print_json(found._asdict())
    elif not args.quiet:
        print_cache(found)
    return 0


def _print_json(summary: Mapping[str, object]) -> None:
    try:
        text = json.dumps(summary, indent=2, allow_nan=False, default=lambda array: array.tolist())
    except ValueError as error:
        raise _Stop(1, f"a result is not a finite number, so there is no JSON: {error}") from None
    print(text)


def _plot(args: argparse.Namespace) -> int:
    """Draw the pictures of a result again."""
    result = args.result / "result.nc" if args.result.is_dir() else args.result
    folder = args.out or result.parent
    try:
        names = draw_again(result, folder, pictures=args.pictures)
    except OSError as error:
        raise _Stop(2, f"cannot write pictures into {folder}: {error.strerror}.") from None
    if not args.quiet:
        print(f"{len(names)} pictures in {folder}: {', '.join(names)}")
    return 0


def _import(args: argparse.Namespace) -> int:
    """Write the scene of a stage of a REXS file, or what a universal file has measured."""
    with _numerical(quiet=True):
        from jaxgear.study._uff58 import is_universal_file

        if is_universal_file(args.file):
            target, remarks = write_measured(args), ()
        else:
            target, remarks = write_imported(args)
    _tell(args, [target], remarks)
    return 0


def _export(args: argparse.Namespace) -> int:
    """Write a body, a scene or a result for another program."""
    with _numerical(quiet=True):
        from jaxgear._cli._export import exported
        from jaxgear.study._statics import SolverFailure

        try:
            _tell(args, *exported(args))
        except SolverFailure as error:
            raise _Stop(1, f"{args.file}: {error}") from error
    return 0


def _tell(args: argparse.Namespace, files: Sequence[Path], remarks: Sequence[str]) -> None:
    """Name the files written, and what there is to say of them."""
    if not args.quiet:
        print("\n".join(map(str, files)))
        print("".join(f"  - {remark}\n" for remark in remarks), end="", file=sys.stderr)


def _report(args: argparse.Namespace) -> int:
    """Write the page of a results folder."""
    from jaxgear.report import report

    target = args.out or args.results / REPORT
    try:
        write_text(report(args.results), target)
    except OSError as error:
        raise _Stop(2, f"cannot write {target}: {error.strerror}.") from None
    if not args.quiet:
        print(target)
    return 0


def _schema(args: argparse.Namespace) -> int:
    """Print the schema of scenes."""
    from jaxgear.scene._json_schema import json_schema

    _print_json(json_schema())
    return 0


def _doctor(args: argparse.Namespace) -> int:
    """Say whether the installation is in order."""
    from jaxgear._cli._doctor import print_findings

    with _numerical(quiet=True):
        return print_findings()


def _init(args: argparse.Namespace) -> int:
    """Write an example scene, or that of one's own pair."""
    target, cite = write_first_scene(args)
    if args.json:
        _print_json({"scene": str(target), "cite": cite})
    elif not args.quiet:
        print(f"{target}: {cite}")
    return 0
