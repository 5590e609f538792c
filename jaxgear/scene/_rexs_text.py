"""REXS models as text: XML (.rexs) and JSON (.rexsj), with every number as it was given."""

import json
import re
import xml.etree.ElementTree as ET
from typing import Any

from jaxgear.scene._rexs_file import RexsModel

# What a number in JSON is between its quotes until they are taken off: floats would round it.
_BARE = "\0"


def rexs_xml(model: RexsModel, date: str) -> str:
    """A model as XML.

    **Arguments:**

    - `model`: to be written; its load cases are not.
    - `date`: of the file, as ISO 8601 has it.
    """
    root = ET.Element(
        "model",
        version=model.version,
        applicationId="jaxgear",
        applicationVersion=model.application,
        date=date,
    )
    relations = ET.SubElement(root, "relations")
    for number, each in enumerate(model.relations, 1):
        # Orders are asked for by the database where one of several could be first.
        relation = ET.SubElement(relations, "relation", id=str(number), type=each.kind)
        if each.kind == "manufacturing_step":
            relation.set("order", "1")
        for role, part in each.roles.items():
            ET.SubElement(relation, "ref", id=part, role=role, hint=model.parts[part].kind)
    components = ET.SubElement(root, "components")
    for part, each in model.parts.items():
        component = ET.SubElement(components, "component", id=part, type=each.kind, name=each.name)
        for name, (text, unit) in each.attributes.items():
            ET.SubElement(component, "attribute", id=name, unit=unit).text = text
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def rexs_json(model: RexsModel, date: str) -> str:
    """A model as JSON.

    **Arguments:**

    - `model`: to be written; its load cases are not.
    - `date`: of the file, as ISO 8601 has it.
    """
    relations = [
        {
            "id": number,
            "type": each.kind,
            **({"order": 1} if each.kind == "manufacturing_step" else {}),
            "refs": [
                {"id": int(part), "role": role, "hint": model.parts[part].kind}
                for role, part in each.roles.items()
            ],
        }
        for number, each in enumerate(model.relations, 1)
    ]
    components = [
        {
            "id": int(part),
            "type": each.kind,
            "name": each.name.replace(_BARE, ""),
            "attributes": [
                {"id": name, "unit": unit, **_typed(name, text)}
                for name, (text, unit) in each.attributes.items()
            ],
        }
        for part, each in model.parts.items()
    ]
    head = {
        "version": model.version,
        "applicationId": "jaxgear",
        "applicationVersion": model.application,
        "date": date,
    }
    whole = {"model": {**head, "relations": relations, "components": components}}
    text = json.dumps(whole, indent=2, ensure_ascii=False)
    return re.sub(r'"\\u0000([^"]*)"', r"\1", text) + "\n"


def _typed(name: str, text: str) -> dict[str, Any]:
    """The value of an attribute under the name of its type."""
    if name == "number_of_teeth":
        return {"integer": int(text)}
    if text in ("true", "false"):
        return {"boolean": text == "true"}
    if text[-1].isdigit():
        return {"floating_point": _BARE + text}
    return {"enum": text}
