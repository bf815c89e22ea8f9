"""Types of the code as tables of the documentation: their fields with type, unit, default and docstring."""

import ast
import inspect
import re
from enum import Enum
from types import ModuleType
from typing import Any

import msgspec

from swarmware.types.quantised import Form
from swarmware.types.units import unit_of


def cell(text: str) -> str:
    """Text of a cell of a table."""
    prose = re.split(r"(`[^`]*`)", " ".join(text.split()))
    prose[::2] = [part.replace("<", "&lt;") for part in prose[::2]]  # a page would take <platform> as HTML
    return "".join(prose).replace("|", "\\|")


def field_docs(module: ModuleType) -> dict[tuple[str, str], str]:
    """The docstrings below fields and members of enumerations of a module's classes, by class and name."""
    found = {}
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if not isinstance(node, ast.ClassDef):
            continue
        for field, below in zip(node.body, node.body[1:], strict=False):
            match field:
                case ast.AnnAssign(target=ast.Name(id=name)) | ast.Assign(targets=[ast.Name(id=name)]):
                    pass
                case _:
                    continue
            match below:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    found[node.name, name] = text
    return found


def wire_type(kind: Any) -> str:
    """A field's type as the page writes it."""
    match kind:
        case msgspec.inspect.BoolType():
            return "`bool`"
        case msgspec.inspect.IntType(ge=low, le=high):
            return "`int`" if low is None and high is None else f"`int` [{_bound(low)}, {_bound(high)}]"
        case msgspec.inspect.FloatType(ge=low, le=high):
            return "`float`" if low is None and high is None else f"`float` [{_real(low)}, {_real(high)}]"
        case msgspec.inspect.StrType(max_length=longest):
            return "`text`" if longest is None else f"`text`, at most {longest} characters"
        case msgspec.inspect.BytesType():
            return "`bytes`"
        case msgspec.inspect.NoneType():
            return "nil"
        case msgspec.inspect.AnyType():
            return "anything"
        case msgspec.inspect.LiteralType(values=values):
            return " | ".join(f'`"{value}"`' for value in values)
        case msgspec.inspect.EnumType(cls=cls):
            return " | ".join(f'`"{one.value}"`' for one in cls)
        case msgspec.inspect.StructType(cls=cls):
            return f"[{cls.__name__}](#{cls.__name__.lower()})"
        case msgspec.inspect.VarTupleType(item_type=item, max_length=longest):
            return f"[{wire_type(item)}]" + ("" if longest is None else f", at most {longest}")
        case msgspec.inspect.TupleType(item_types=items):
            return f"[{', '.join(map(wire_type, items))}]"
        case msgspec.inspect.DictType(key_type=key, value_type=value):
            return f"{{{wire_type(key)}: {wire_type(value)}}}"
        case msgspec.inspect.UnionType(types=types):
            rest = [one for one in types if not isinstance(one, msgspec.inspect.NoneType)]
            return " | ".join(map(wire_type, rest)) + ("?" if len(rest) < len(types) else "")
    raise TypeError(f"{kind!r}: a field of a payload; expected a type that this page can name")


def _bound(number: float | None) -> str:
    if number is None:
        return "…"
    if isinstance(number, int) and number > 1 << 16:
        power = (number + 1).bit_length() - 1
        return f"2^{power} − 1" if number == (1 << power) - 1 else str(number)
    if isinstance(number, int) and -number > 1 << 16:
        power = (-number).bit_length() - 1
        return f"−2^{power}" if -number == 1 << power else str(number)
    return _real(number)


def _real(number: float | None) -> str:
    """The bound of a float: typing gives 1e6 or 1_000_000, whichever module wrote the same bound first."""
    return "…" if number is None else f"{number:g}".replace("-", "−")


def unit(name: str, wire: str) -> str:
    """Unit that the name of a field ends with."""
    return unit_of(name, whole="int" in wire)


def default(field: msgspec.inspect.Field) -> str:
    """Default of a field, as JSON."""
    if field.required:
        return ""
    value = field.default if field.default is not msgspec.NODEFAULT else field.default_factory()
    if isinstance(value, msgspec.Struct):
        return "its own"
    return f"`{msgspec.json.encode(value).decode()}`"


def struct_section(cls: type[msgspec.Struct], docs: dict[tuple[str, str], str], level: str = "###") -> str:
    """One type: what it is, its layout, its fields."""
    info = msgspec.inspect.type_info(cls)
    assert isinstance(info, msgspec.inspect.StructType)
    layout = "array" if info.array_like else "map"
    if cls.__struct_config__.omit_defaults:
        layout += ", without fields that equal their default"
    out = [f"\n{level} {cls.__name__}\n\n{cell(inspect.getdoc(cls) or '')} ({layout})\n"]
    if info.fields:
        out.append("\n| | field | type | unit | default | |\n|---|---|---|---|---|---|\n")
    for number, field in enumerate(info.fields):
        wire = wire_type(field.type)
        doc = docs.get((cls.__name__, field.name), "")
        if isinstance(field.type, msgspec.inspect.EnumType):
            doc = " ".join([doc, *_meanings(field.type.cls, docs)]).strip()
        cells = (
            str(number), f"`{field.encode_name}`", wire, unit(field.name, wire), default(field), doc,
        )  # fmt: skip
        out.append(f"| {' | '.join(cell(one) for one in cells)} |\n")
    forms: tuple[Form, ...] = getattr(cls, "forms", ())
    out += [_form_table(cls.__name__, form) for form in forms]
    return "".join(out)


def _meanings(vocabulary: type[Enum], docs: dict[tuple[str, str], str]) -> list[str]:
    """What those values of a vocabulary mean that do not say it themselves."""
    known = ((one.value, docs.get((vocabulary.__name__, one.name))) for one in vocabulary)
    return [f"`{value}`: {text[:1].lower()}{text[1:].rstrip('.')}." for value, text in known if text]


def _form_table(name: str, form: Form) -> str:
    rows, at = [], 0
    for part in form.parts:
        rows.append(f"| {at} | {part.name} | {part.wire} | {cell(part.meaning)} |\n")
        at += part.size
    if form.rest:
        rows.append(f"| {at} | | | {cell(form.rest)} |\n")
    return (
        f"\nQuantised form of {name}, {form.when}:\n\n| at | | type | |\n|---|---|---|---|\n{''.join(rows)}"
    )
