"""A cylindrical stage of a REXS file: which it is, which gear drives, under which load case."""

from collections.abc import Sequence
from typing import NamedTuple

from jaxgear._checks import InputError, require
from jaxgear.scene._rexs_file import Component, RexsModel
from jaxgear.scene._schema import GEARS

# Type of a gear, and the roles that two of them play in a stage.
GEAR, ROLES = "cylindrical_gear", ("gear_1", "gear_2")


class RexsStage(NamedTuple):
    """A stage of a file, as it is read.

    **Fields:**

    - `model`: it is in, under its load case.
    - `stage`: its identifier.
    - `gears`: identifiers of pinion and wheel.
    - `remarks`: what was left out or assumed, so far.
    """

    model: RexsModel
    stage: str
    gears: Sequence[str]
    remarks: list[str]

    def part(self, gear: str) -> Component:
        """A gear of the stage, `pinion` or `wheel`."""
        return self.model.parts[self.gears[GEARS.index(gear)]]

    def shaft_of(self, gear: str) -> str:
        """Identifier of the shaft of a gear, `pinion` or `wheel`."""
        return shaft_of(self.model, self.gears[GEARS.index(gear)])


def stage_of(model: RexsModel, stage: str, case: str) -> RexsStage:
    """Find a stage and its load case.

    **Arguments:**

    - `model`: what the file holds.
    - `stage`: identifier of the stage; may be left out where there is one.
    - `case`: identifier of the load case; the first without it.

    **Raises:**

    - `InputError` if there is no such stage or load case.
    """
    remarks: list[str] = []
    loaded = _loaded(model, case, remarks)
    return RexsStage(loaded, *_gears_of(loaded, stage), remarks)


def _loaded(model: RexsModel, case: str, remarks: list[str]) -> RexsModel:
    """The model under the load case asked for, or the first."""
    known = ", ".join(model.cases)
    if case:
        words = "there is no load case {got}; there are: {known}."
        require(case in model.cases, words, got=case, known=known or "none")
    elif not model.cases:
        return model
    chosen = case or next(iter(model.cases))
    if len(model.cases) > 1:
        remarks.append(f"Load case {chosen} is taken, of {known}: --load-case names another.")
    return model.under(chosen)


def _gears_of(model: RexsModel, stage: str) -> tuple[str, list[str]]:
    """Identifiers of the stage, and of its driving and driven gear."""
    stages = {
        refs["stage"]: [refs[role] for role in ROLES]
        for refs in model.those("stage")
        if "stage" in refs and all(model.is_a(refs.get(role, ""), GEAR) for role in ROLES)
    }
    told = [
        f"{each} ({' and '.join(f'{teeth_of(model.parts[gear]):g}' for gear in gears)} teeth)"
        for each, gears in stages.items()
    ]
    require(stages, "there is no stage of two external cylindrical gears in the file.")
    require(
        stage in stages or (not stage and len(stages) == 1),
        "name one of its stages with --stage: {told}.",
        told=", ".join(told),
    )
    chosen = stage or next(iter(stages))

    def order(gear: str) -> tuple[bool, float]:
        data = [
            model.parts[refs.get("stage_gear_data", "")]
            for refs in model.those("stage_gear_data", stage=chosen, gear=gear)
            if refs.get("stage_gear_data") in model.parts
        ]
        drives = any(x.attributes.get("is_driving_gear", ("", ""))[0] == "true" for x in data)
        return not drives, teeth_of(model.parts[gear])

    return chosen, sorted(stages[chosen], key=order)


def teeth_of(gear: Component) -> float:
    """Number of teeth of a gear, refused below 1."""
    number = float(gear.needed("number_of_teeth"))
    require(number >= 1.0, "{name} must have teeth, got {got:g}.", name=gear.name, got=number)
    return number


def shaft_of(model: RexsModel, gear: str) -> str:
    """Identifier of the shaft that carries a component; refused where there is none."""
    for refs in model.those("assembly", part=gear):
        if model.is_a(shaft := refs.get("assembly", ""), "shaft"):
            return shaft
    raise InputError(f"The gear {gear} is on no shaft.")


def parts_on(it: RexsStage, shaft: str, kind: str) -> list[Component]:
    """Components of a kind on a shaft."""
    return it.model.related("assembly", "part", kind, assembly=shaft)
