"""Which programs a command has XLA compile, and what each of them costs.

    python benchmarks/programs.py run accessory.toml [--set KEY=VALUE ...] [--out DIR] [--places]
    python benchmarks/programs.py run accessory.toml --again pair.torque_pinion_Nm=100

Runs a command in this process and prints one row for each program, the dearest first: how often it
was lowered, equations of its jaxpr (those of inner functions counted where they are called), and
seconds of this process's processors to trace, to lower and to compile it, or to fetch it from the
cache that `JAX_COMPILATION_CACHE_DIR` names. `--places` adds the line of ours that asked for it.
`--again` runs the command once more with another value in the same process, and shows that run:
what is listed then depends on a value that should have been an argument. It looks into JAX where
JAX has no door, so it holds for the versions in `constraints.txt` only.
"""

import argparse
import dataclasses
import sys
import tempfile
import time
import traceback
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from timing import one_thread

OURS = tuple(f"{Path(__file__).parents[1] / name}/" for name in ("jaxgear", "optimise", "fem_prep"))

# Of ours, how many lines of the stack say where a program comes from.
_FRAMES = 4


@dataclasses.dataclass
class Program:
    """One program as XLA got it; seconds are of the process's processors."""

    name: str
    equations: int
    place: str
    trace: float
    lower: float = 0.0
    compile: float = 0.0
    hit: bool = False


@dataclasses.dataclass
class _Span:
    """A piece of JAX's work that has begun; what other kinds of work took within it is not its."""

    event: str
    begin: float
    elsewhere: float = 0.0


class Recorder:
    """Follows JAX from tracing to compiling: one row for each program, in order."""

    def __init__(self):
        self.programs: list[Program] = []
        self._spans: list[_Span] = []
        self._traced = 0.0

    def begin(self, event: str) -> None:
        """A piece of work begins."""
        self._spans.append(_Span(event, time.process_time()))

    def end(self) -> None:
        """The piece of work that began last has ended."""
        span = self._spans.pop()
        whole = time.process_time() - span.begin
        own = whole - span.elsewhere
        kind = span.event.rpartition("/")[2]
        outer = self._spans[-1] if self._spans else None
        if kind == "jaxpr_trace_duration":
            # Traces within a trace are of one program.
            if outer is not None and outer.event == span.event:
                outer.elsewhere += span.elsewhere
                return
            self._traced += own
        elif kind == "jaxpr_to_mlir_module_duration" and self.programs:
            self.programs[-1].lower += own
        elif kind == "backend_compile_duration" and self.programs:
            self.programs[-1].compile += own
        if outer is not None:
            outer.elsewhere += whole

    def lowered(self, name: str, equations: int) -> None:
        """A program has been traced, and is about to be lowered."""
        self.programs.append(Program(name, equations, _place(), self._traced))
        self._traced = 0.0

    def hit(self) -> None:
        """The last program came from the cache."""
        self.programs[-1].hit = True


def _place() -> str:
    """The innermost lines of ours on the stack, where the program was asked for and by whom."""
    stack = [each for each in traceback.extract_stack() if each.filename.startswith(OURS)]
    names = [f"{Path(each.filename).stem}:{each.lineno}" for each in reversed(stack)]
    return " < ".join(names[:_FRAMES])


def equations_of(jaxpr) -> int:
    """Equations of a jaxpr and of all that it calls."""
    count = len(jaxpr.eqns)
    for equation in jaxpr.eqns:
        for value in equation.params.values():
            for each in value if isinstance(value, tuple | list) else (value,):
                each = getattr(each, "jaxpr", each)
                if hasattr(each, "eqns"):
                    count += equations_of(each)
    return count


@contextmanager
def recorded() -> Generator[Recorder]:
    """Record the programs of all that runs within."""
    import jax
    from jax._src import dispatch
    from jax._src.interpreters import mlir

    recorder = Recorder()
    span, lower = dispatch.LogElapsedTimeContextManager, mlir.lower_jaxpr_to_module
    enter, leave = span.__enter__, span.__exit__

    def begin(self):
        recorder.begin(self.event or "")
        return enter(self)

    def end(self, exc_type, exc_value, traceback):
        recorder.end()
        return leave(self, exc_type, exc_value, traceback)

    def lowering(name, jaxpr, **others):
        recorder.lowered(name, equations_of(jaxpr.jaxpr))
        return lower(name, jaxpr, **others)

    def heard(event, **_):
        if event == "/jax/compilation_cache/cache_hits":
            recorder.hit()

    jax.monitoring.register_event_listener(heard)
    span.__enter__, span.__exit__ = begin, end
    mlir.lower_jaxpr_to_module = lowering  # ty: ignore[invalid-assignment]
    try:
        yield recorder
    finally:
        span.__enter__, span.__exit__, mlir.lower_jaxpr_to_module = enter, leave, lower


def table(programs: list[Program], places: bool) -> list[str]:
    """Rows of all programs, those of one name and place together, the dearest first."""
    groups: dict[tuple[str, ...], list[Program]] = {}
    for each in programs:
        key = (each.name, each.place) if places else (each.name,)
        groups.setdefault(key, []).append(each)
    cost = lambda group: sum(each.trace + each.lower + each.compile for each in group)
    form = "{:<36} {:>5} {:>9} {:>8} {:>8} {:>8} {:>5}  {}"
    rows = [form.format("program", "count", "equations", "trace", "lower", "compile", "hits", "")]
    for group in [*sorted(groups.values(), key=cost, reverse=True), programs]:
        total = lambda name, group=group: sum(getattr(each, name) for each in group)
        seconds = [f"{total(name):.3f}" for name in ("trace", "lower", "compile")]
        last = group is programs
        rows.append(
            form.format(
                "all" if last else group[0].name[:36],
                len(group),
                total("equations"),
                *seconds,
                total("hit"),
                group[0].place if places and not last else "",
            )
        )
    return rows


def main() -> None:
    """Run a command and print its programs."""
    parser = argparse.ArgumentParser(description="Which programs a command has XLA compile.")
    parser.add_argument("command")
    parser.add_argument("scene")
    parser.add_argument("--again", metavar="KEY=VALUE", help="show a second run, with this changed")
    parser.add_argument("--places", action="store_true", help="say which line asked for each")
    options, others = parser.parse_known_args()
    one_thread()
    if "--out" not in others:
        others += ["--out", tempfile.mkdtemp()]
    command = [options.command, options.scene, "--quiet", *others]
    start = time.process_time()
    from jaxgear._cli._main import main as jaxgear

    print(f"importing {time.process_time() - start:.2f} s of processors")
    runs = [command] + ([[*command, "--set", options.again]] if options.again else [])
    code = 0
    for arguments in runs:
        start = time.process_time()
        with recorded() as recorder:
            code = max(code, jaxgear(arguments))
        seconds = time.process_time() - start
        print(f"{' '.join(arguments[:2])}: exit {code}, {seconds:.2f} s of processors")
    print("\n".join(table(recorder.programs, options.places)))
    sys.exit(code)


if __name__ == "__main__":
    main()
