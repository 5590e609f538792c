"""One command line or script in a process of its own, watched: what it spends its seconds on.

    python answer_child.py SPANS.json jaxgear run accessory.toml
    python answer_child.py SPANS.json python SCRIPT.py

It needs nothing but the standard library, so that any environment's Python, with any version of
jaxgear, can be measured by it. It writes spans, each a kind, a begin and an end on the clock, which
nest, and pairs of clock and processor seconds.
"""

import functools
import importlib.machinery
import json
import runpy
import sys
import time

_EVENTS = {
    "/jax/core/compile/jaxpr_trace_duration": "trace",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lower",
    "/jax/core/compile/backend_compile_duration": "compile",
    "/jax/compilation_cache/cache_retrieval_time_sec": "cache",
}

spans, clocks = [], []


def _now():
    """Seconds on the clock; what the processor had done by then is kept beside it."""
    moment = time.perf_counter()
    clocks.append((moment, time.process_time()))
    return moment


def _noted(kind, function):
    """The function, with a span for each of its calls."""

    @functools.wraps(function)
    def watched(*arguments, **options):
        begin = _now()
        try:
            return function(*arguments, **options)
        finally:
            spans.append((kind, begin, _now()))

    return watched


def _event(name, seconds, **about):
    """JAX tells how long something took when it has ended."""
    del about
    if name in _EVENTS:
        now = _now()
        spans.append((_EVENTS[name], now - seconds, now))


def _watch(module):
    """Watch what a module that has just come in draws, writes or tells."""
    name = module.__name__
    if name == "jax._src.monitoring":
        module.register_event_duration_secs_listener(_event)
    if not name.startswith(("jaxgear.study.", "jaxgear.plot.", "jaxgear._cli.")):
        return
    for key, value in list(vars(module).items()):
        if getattr(value, "__module__", None) != name or not hasattr(value, "__code__"):
            continue
        if key.startswith("write_") and key != "write_picture":
            setattr(module, key, _noted("write", value))
        elif name.endswith("pictures") and not key.startswith("_"):
            setattr(module, key, _noted("draw", value))


class _Finder:
    """Lets the others find a module, and watches how it is executed."""

    def find_spec(self, name, path, target=None):
        for finder in sys.meta_path:
            spec = None if finder is self else finder.find_spec(name, path, target)
            if spec is not None:
                break
        else:
            return None
        own = importlib.machinery.SourceFileLoader, importlib.machinery.ExtensionFileLoader
        if isinstance(spec.loader, own):
            execute = _noted("import", spec.loader.exec_module)

            def watched(module):
                execute(module)
                _watch(module)

            spec.loader.exec_module = watched
        return spec


def _main():
    target, kind, *arguments = sys.argv[1:]
    begin = _now()
    sys.meta_path.insert(0, _Finder())
    code = 0
    sys.argv = arguments
    try:
        if kind == "python":
            runpy.run_path(arguments[0], run_name="__main__")
        else:
            from jaxgear._cli._main import main

            code = main(arguments)
    except SystemExit as stop:
        code = stop.code
    report = {"begin": begin, "end": _now(), "code": code, "spans": spans, "clocks": clocks}
    with open(target, "w", encoding="utf-8") as file:
        json.dump(report, file)
    sys.exit(code)


if __name__ == "__main__":
    _main()
