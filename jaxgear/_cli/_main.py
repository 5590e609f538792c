"""The command line: reads the scene, refuses what cannot be, and hands over to the commands.

Standard output carries results only; everything else goes to standard error. Exit codes: 0
success, 2 a bad scene or an impossible gear, 1 a solver that failed, 130 interrupted. The
commands are imported only once the scene is known to be good.
"""

import _thread
import argparse
import gc
import importlib.metadata
import io
import json
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import Any

from jaxgear._checks import InputError
from jaxgear._cli._folder import Folder, begun, publish, written
from jaxgear._cli._init import add_init_parser, write_first_scene
from jaxgear._cli._keys import add_keys_parser, print_keys
from jaxgear._cli._terminal import Terminal, warn
from jaxgear._program_cache import cache_compilations
from jaxgear.scene._motion import motion_mistakes
from jaxgear.scene._scene import Mistake, Scene, SceneError, read_scene
from jaxgear.scene._schema import GEARS
from jaxgear.scene._slips import odd
from jaxgear.study._symbols import with_symbol

_COMMANDS = {
    "run": "compute everything that the scene asks for",
    "map": "Master Curve map: RMS of transmission error over relief depth and extent",
    "optimise": "improve the keys of [optimise].vary; writes NAME.optimised.toml",
    "sweep": "steady responses over the speeds of [sweep]: dynamic ratio, orders, jumps",
    "modes": "natural frequencies, where their energy is, critical speeds",
    "check-grad": "compare the optimiser's derivatives with central differences",
    "sensitivity": "what the responses react to: per cent per per cent of each key, as bars",
    "compare": "one scene by many models and methods: error against time, and which suffices",
    "condense": "build the condensed bodies of the scene: files, pictures, health report",
}

# Many threads make the many small matrices of a gear pair several times slower.
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class _Stop(Exception):
    """A reason to stop that the user can act on.

    **Fields:**

    - `code`: exit code.
    """

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
    if sys.stdout is None:
        # Closed, as some services start their commands.
        sys.stdout = open(os.devnull, "w")
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
def _kept_interrupts() -> Iterator[None]:
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


def print_summary(summary: Mapping[str, object], indent: str = "") -> None:
    """Print a summary for a reader: nested keys indented, six digits, long lists by their length.

    Beside the names of results stand the symbols of the ISO standards.

    **Arguments:**

    - `summary`: nested dictionary; units are part of its keys.
    - `indent`: what each line begins with.
    """
    width = max((len(with_symbol(key)) for key in summary), default=0)
    for key, value in summary.items():
        if isinstance(value, Mapping):
            print(f"{indent}{key}")
            print_summary(value, indent + "  ")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            for index, row in enumerate(value):
                if not any(isinstance(each, Mapping) for each in row.values()):
                    words = [f"{name} {_short(each)}" for name, each in row.items()]
                    print(f"{indent}{key}[{index}]  {', '.join(words)}")
                    continue
                print(f"{indent}{key}[{index}]")
                print_summary(row, indent + "  ")
        else:
            print(f"{indent}{with_symbol(key):<{width}}  {_short(value)}")


def _print_notes(notes: Sequence[str]) -> None:
    """Print all notes, the worst first, each on a line of its own."""
    if notes:
        print("notes")
    for note in notes:
        print(f"  - {note}")


def _short(value: object) -> str:
    if isinstance(value, str | int):
        return str(value)
    if isinstance(value, list | tuple):
        few = len(value) <= 6
        return "[" + ", ".join(map(_short, value)) + "]" if few else f"[{len(value)} values]"
    try:
        return f"{value:.6g}"
    except (TypeError, ValueError):
        return str(value)


class _Parser(argparse.ArgumentParser):
    """A parser whose help fails where it cannot be written; the library's own says nothing."""

    def _print_message(self, message: str, file: Any = None) -> None:
        if file is sys.stdout:
            file.write(message)
        else:
            super()._print_message(message, file)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="jaxgear",
        description="Differentiable gear dynamics: from a scene file to transmission error, "
        "contact, and better flanks.",
        epilog="Begin with: jaxgear init accessory; jaxgear run accessory.toml",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"jaxgear {_version()}")
    options = _Parser(add_help=False, allow_abbrev=False)
    options.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder for the results; in it each command but run has one of its own",
    )
    options.add_argument(
        "--set",
        action="append",
        default=[],
        dest="overrides",
        metavar="KEY=VALUE",
        help="change a key of the scene, e.g. pair.torque_pinion_Nm=120; repeatable",
    )
    options.add_argument("--json", action="store_true", help="print the summary as JSON")
    options.add_argument(
        "--quiet", action="store_true", help="print nothing but errors, and the JSON if asked for"
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    add_init_parser(commands, [options])
    for name, text in _COMMANDS.items():
        command = commands.add_parser(name, parents=[options], help=text, allow_abbrev=False)
        command.add_argument("scene", metavar="SCENE", type=Path, help="scene file (TOML)")
        command.add_argument(
            "--no-pictures",
            action="store_false",
            dest="pictures",
            help="draw none, and write only their data",
        )
    add_keys_parser(commands)
    cache = commands.add_parser(
        "cache",
        help="list the condensed bodies and compiled programs that are kept, or remove them",
        allow_abbrev=False,
    )
    cache.add_argument("--clear", action="store_true", help="remove all of them")
    cache.add_argument("--json", action="store_true", help="print the list as JSON")
    cache.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return parser


def _version() -> str:
    try:
        return importlib.metadata.version("jaxgear")
    except importlib.metadata.PackageNotFoundError:
        return "(not installed)"


def _command(argv: Sequence[str] | None) -> int:
    """Carry out one command line and return its exit code."""
    try:
        args = _parser().parse_args(argv)
    except SystemExit as stop:
        return int(stop.code or 0)
    _refuse_unspeakable(args)
    if args.command == "init":
        return _init(args)
    if args.command == "cache":
        return _cache(args)
    if args.command == "keys":
        return print_keys(args)
    scene = read_scene(args.scene, args.overrides)
    _refuse_unfit(args.command, scene)
    for remark in odd(scene.whole):
        warn(remark)
    with _results(args, scene) as folder:
        summary = _compute(args.command, scene, folder, args.quiet)
    wrong = summary["check_grad"]["verdicts"]["WRONG"] if "check_grad" in summary else 0
    if args.json:
        _print_json(summary)
    elif "check_grad" in summary:
        _print_gradients(summary["check_grad"])
    elif args.command == "modes" and not args.quiet:
        _print_modes(summary["modes"])
    elif args.command == "condense" and not args.quiet:
        _print_bodies(summary["bodies"])
    elif not args.quiet:
        apart = ("versions", "notes")
        print_summary({key: value for key, value in summary.items() if key not in apart})
    if not (args.json or args.quiet):
        _print_notes(summary.get("notes", ()))
    if not args.quiet:
        print(f"results in {folder.path}", file=sys.stderr)
    if wrong:
        raise _Stop(
            1,
            f"{wrong} derivatives disagree with central differences; they are "
            f"marked WRONG in {folder.path / 'gradients.csv'}.",
        )
    return 0


def _refuse_unspeakable(args: argparse.Namespace) -> None:
    """Refuse bytes that are no text: they would come to light where results are written."""
    for value in (getattr(args, "scene", ""), args.out, *args.overrides) if "out" in args else ():
        try:
            str(value).encode()
        except UnicodeEncodeError:
            told = str(value).encode(errors="backslashreplace").decode()
            raise _Stop(2, f"arguments must be text in UTF-8, got {told}") from None


def _print_gradients(found: Mapping[str, Any]) -> None:
    """Print the table of derivatives; rows without effect are only counted."""
    form = "{:<8} {:<24} {:<40} {:>14} {:>14} {:>14} {:>10}  {}"
    names = ("contact", "response", "key", "forward", "reverse", "central", "rel. error", "verdict")
    print(form.format(*names))
    for row in found["rows"]:
        if row["verdict"] != "no effect":
            numbers = [_short(row[name]) for name in ("forward", "reverse", "difference")]
            words = row["contact"], row["response"], row["key"]
            print(form.format(*words, *numbers, f"{row['error']:.1e}", row["verdict"]))
    print(", ".join(f"{count} {verdict}" for verdict, count in found["verdicts"].items()))


def _print_modes(found: Mapping[str, Any]) -> None:
    """Print the table of natural modes."""
    parts = [name for name in ("mesh", "pinion", "wheel", "bearings") if any(found["energy"][name])]
    columns = [found["frequency_Hz"], [100.0 * ratio for ratio in found["damping_ratio"]]]
    columns += [[100.0 * share for share in found["energy"][name]] for name in parts]
    columns.append(found["critical_speed_rad_s"]["mesh_harmonic_1"])
    heads = ["mode", "Hz", "damping %", *(f"{name} %" for name in parts), "critical rad/s"]
    form = "{:>4}" + "  {:>11}" * (len(heads) - 2) + "  {:>14}"
    # Of condensed bodies: the gear of the leading wave, and its nodal diameters.
    names, numbers = found.get("gear", ()), found.get("nodal_diameter", ())
    waves = [f"  {gear:>6}  {count:>9}" for gear, count in zip(names, numbers, strict=True)]
    print(form.format(*heads) + (f"  {'gear':>6}  {'diameters':>9}" if waves else ""))
    for number, row in enumerate(zip(*columns, strict=True), start=1):
        cells = [f"{row[0]:.6g}", *(f"{value:.3f}" for value in row[1:-1]), f"{row[-1]:.6g}"]
        print(form.format(number, *cells) + (waves[number - 1] if waves else ""))


def _print_bodies(found: Sequence[Mapping[str, Any]]) -> None:
    """Print the health reports of condensed bodies."""
    from jaxgear._cli._body_report import report_lines

    for body in found:
        print("\n".join(report_lines(body)))


def _refuse_unfit(command: str, scene: Scene) -> None:
    """Refuse a good scene that does not go with the command."""
    condensed = scene.condensed
    if command == "condense" and not condensed:
        raise _Stop(2, _nothing_to_condense(scene))
    if condensed and command != "condense":
        if scene["mesh.stiffness"] == "iso6336":
            raise SceneError([_counted_twice(scene)])
    if command == "sweep" and not scene.has_table("sweep"):
        raise _Stop(
            2,
            f"{scene.path}: the scene does not say which speeds to sweep. Add these lines:\n\n"
            "[sweep]\n"
            "pinion_speed_rad_s = { from = 50.0, to = 3000.0, points = 300 }    # or a list\n"
            'direction = "both"                    # up | down | both | cold\n',
        )
    if command == "sweep" or (command == "run" and scene.has_table("sweep")):
        mistakes = _sweep_mistakes(scene)
        if mistakes:
            raise SceneError(mistakes)
    if command in ("compare", "sensitivity", "check-grad") and scene.has_table("sweep"):
        mistakes = motion_mistakes(scene, harmonic=True)
        if mistakes:
            raise SceneError(mistakes)
    if command == "optimise" and not scene.has_table("optimise"):
        raise _Stop(
            2,
            f"{scene.path}: the scene does not say what to optimise. Add a table [optimise] with "
            'vary = ["flank.pinion.tip_relief.depth_um"], or more keys.',
        )


def _nothing_to_condense(scene: Scene) -> str:
    """Say what a condensed body would be, or which key keeps it from being one."""
    for gear in GEARS:
        for source in ("web", "grid", "superelement"):
            if scene.has_table(f"{gear}.body.{source}"):
                kind = scene[f"{gear}.body.kind"]
                return (
                    f"{scene.path}: no gear body of the scene is condensed: {gear}.body has "
                    f'{source}, but its kind is "{kind}". Write kind = "condensed" in '
                    f"[{gear}.body], or --set {gear}.body.kind=condensed."
                )
    return (
        f"{scene.path}: no gear body of the scene is condensed. Write, for instance,\n\n"
        '[wheel.body]\nkind = "condensed"\n'
        "web = { hub_outer_mm = 50.0, web_thickness_mm = 4.0, rim_inner_mm = 118.0 }\n\n"
        "or leave web out for a solid body."
    )


def _counted_twice(scene: Scene) -> Mistake:
    """Say why a standard's stiffness and a condensed body exclude each other."""
    words = (
        'got "iso6336", whose stiffness includes the gear body, and a condensed body brings its '
        'own. Write "weber-banaschek"'
    )
    return Mistake(scene.where("mesh.stiffness"), "mesh.stiffness", words)


def _sweep_mistakes(scene: Scene) -> list[Mistake]:
    """What is wrong with a scene, good as it is for all else, if it is to be swept."""
    method = scene["sweep.method"]
    found = motion_mistakes(scene, harmonic=method in ("auto", "harmonic"))
    if scene.get("sweep.continuation") and method in ("newmark", "shooting"):
        key = "sweep.continuation"
        words = f'got true, which needs harmonic balance, but sweep.method is "{method}". Keep one'
        found.append(Mistake(scene.where(key), key, words))
    return found


@contextmanager
def _results(args: argparse.Namespace, scene: Scene) -> Iterator[Folder]:
    """The folder of a command; refused, before any long work, if it cannot be written to."""
    common = args.out or Path("results") / str(scene["name"])
    path = common if args.command == "run" else common / args.command
    own = path / "scene.toml"
    with ExitStack() as stack:
        try:
            if own.exists() and own.samefile(scene.path) and own.name not in written(path):
                raise _Stop(
                    2, f"{own}: the results would replace the scene. Name another folder: --out DIR"
                )
            folder = stack.enter_context(begun(Folder(path, args.pictures, common=common)))
        except (OSError, ValueError) as error:
            # A name that the file system cannot spell is a ValueError.
            why = error.strerror if isinstance(error, OSError) else error
            raise _Stop(
                2, f"cannot write results into {path}: {why}. Name another folder with --out DIR."
            ) from None
        yield folder


def _shown(quiet: bool) -> AbstractContextManager[None]:
    """Show progress, or none."""
    from jaxgear.study import listened_by

    return nullcontext() if quiet else listened_by(Terminal())


def _compute(command: str, scene: Scene, folder: Folder, quiet: bool) -> Mapping[str, Any]:
    """Run the numerical part with 64-bit numbers and one BLAS thread."""
    import jax
    import threadpoolctl

    jax.config.update("jax_enable_x64", True)
    cache_compilations(warn)
    # Python would look for garbage over and over through all that JAX has traced.
    gc.set_threshold(200_000, 50, 100)
    from jaxgear._cli import _commands
    from jaxgear.study import stopwatch
    from jaxgear.study._statics import SolverFailure

    try:
        # The environment is too late for a library that is loaded already; this is not.
        with threadpoolctl.threadpool_limits(1), _shown(quiet), stopwatch():
            summary = _commands.COMMANDS[command](scene, folder)
        publish(folder)
        return summary
    except SolverFailure as error:
        raise _Stop(1, f"{scene.path}: {error}") from error
    except InputError as error:
        raise _Stop(2, f"{scene.path}: {error}") from error
    except FloatingPointError as error:
        raise _Stop(1, f"{scene.path}: {error}") from error
    except BrokenPipeError:
        raise
    except OSError as error:
        raise _Stop(1, f"cannot write results into {folder.path}: {error}") from error


def _cache(args: argparse.Namespace) -> int:
    """List what the cache holds, or remove it."""
    from jaxgear._cli._cache import cache_summary, cleared, print_cache

    found = cleared() if args.clear else cache_summary()
    if args.json:
        _print_json(found)
    elif not args.quiet:
        print_cache(found)
    return 0


def _print_json(summary: Mapping[str, object]) -> None:
    try:
        text = json.dumps(summary, indent=2, allow_nan=False, default=lambda array: array.tolist())
    except ValueError as error:
        raise _Stop(1, f"a result is not a finite number, so there is no JSON: {error}") from None
    print(text)


def _init(args: argparse.Namespace) -> int:
    """Write a ready scene, or that of one's own pair."""
    try:
        target, cite = write_first_scene(args)
    except InputError as error:
        raise _Stop(2, str(error)) from None
    if args.json:
        _print_json({"scene": str(target), "cite": cite})
    elif not args.quiet:
        print(f"{target}: {cite}")
    return 0
