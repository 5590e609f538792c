"""What a command says of its results on standard output."""

from collections.abc import Mapping, Sequence
from typing import Any

from jaxgear.study._symbols import with_symbol


def print_results(command: str, summary: Mapping[str, Any]) -> None:
    """Print what a command has found: a table where it has one, else its summary."""
    if "check_grad" in summary:
        print_gradients(summary["check_grad"])
    elif command == "modes":
        _print_modes(summary["modes"])
    elif command == "condense":
        from jaxgear._cli._body_report import report_lines

        for body in summary["bodies"]:
            print("\n".join(report_lines(body)))
    else:
        apart = ("versions", "notes")
        print_summary({key: value for key, value in summary.items() if key not in apart})


def print_summary(summary: Mapping[str, object], indent: str = "") -> None:
    """Print a summary for a reader: nested keys indented, six digits, long lists by their length.

    Beside the names of results stand the symbols of the ISO standards.
    """
    width = max((len(with_symbol(key)) for key in summary), default=0)
    for key, value in summary.items():
        if isinstance(value, Mapping):
            print(f"{indent}{key}")
            print_summary(value, indent + "  ")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            for index, row in enumerate(value):
                if any(isinstance(each, Mapping) for each in row.values()):
                    print(f"{indent}{key}[{index}]")
                    print_summary(row, indent + "  ")
                else:
                    words = [f"{name} {_short(each)}" for name, each in row.items()]
                    print(f"{indent}{key}[{index}]  {', '.join(words)}")
        else:
            print(f"{indent}{with_symbol(key):<{width}}  {_short(value)}")


def print_notes(notes: Sequence[str]) -> None:
    """Print all notes, the worst first, each on a line of its own."""
    if notes:
        print("notes")
    for note in notes:
        print(f"  - {note}")


def print_gradients(found: Mapping[str, Any]) -> None:
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
