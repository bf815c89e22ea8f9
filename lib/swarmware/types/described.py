"""Classes made from descriptions: values of a type of which no module is installed here."""

import ast
import keyword
from typing import Annotated, Any, Final, Literal

import msgspec

from swarmware.errors import WireError
from swarmware.types.description import FieldDescription, StructDescription, TypeDescription

_SIMPLE: Final[dict[str, Any]] = {
    "Any": Any,
    "bool": bool,
    "bytes": bytes,
    "float": float,
    "int": int,
    "str": str,
}
DEPTH_LIMIT: Final = 30
"""Types inside types: a hundredth of the interpreter's stack."""


def class_of(description: TypeDescription) -> type[msgspec.Struct]:
    """A Struct that decodes, shows and encodes values of the described type.

    Raises: WireError when it is not the description of a type.
    """
    return _ClassMaker(description).top()


class _ClassMaker:
    """Makes the described types, those that a type names before it."""

    def __init__(self, description: TypeDescription) -> None:
        self._top = description.top.name
        self._described = {one.name: one for one in description.structs}
        self._made: dict[str, type[msgspec.Struct] | None] = {}

    def top(self) -> type[msgspec.Struct]:
        made = self._struct(self._top, 0)
        if made is None:
            raise WireError(f"type {self._top}: holds itself only")
        return made

    def _struct(self, name: str, depth: int) -> type[msgspec.Struct] | None:
        """The type of that name, or None while it is being made, because it holds itself."""
        if name in self._made:
            return self._made[name]
        if depth > DEPTH_LIMIT:
            raise WireError(f"type {self._top}: nested deeper than {DEPTH_LIMIT} types")
        # marked before its fields are made, which may refer to it
        self._made[name] = None
        described = self._described[name]
        try:
            made = self._defined(described, depth)
        except (TypeError, ValueError, NameError, OverflowError, RecursionError) as error:
            if isinstance(error, WireError):
                raise
            raise WireError(f"type {name}: not a description of a type: {error}") from error
        self._made[name] = made
        return made

    def _defined(self, described: StructDescription, depth: int) -> type[msgspec.Struct]:
        fields: list[Any] = []
        renamed: dict[str, str] = {}
        for place, field in enumerate(described.fields):
            # a language other than Python may have described the type
            usable = field.name.isidentifier() and not keyword.iskeyword(field.name)
            name = field.name if usable and not field.name.startswith("_") else f"field_{place}"
            if name != field.name:
                renamed[name] = field.name
            fields.append(self._field(name, field, depth))
        name = described.name if described.name.isidentifier() else "Described"
        made = msgspec.defstruct(
            name,
            fields,
            namespace={"__doc__": described.meaning},
            module=__name__,
            array_like=described.array,
            frozen=True,
            kw_only=True,
            rename=renamed or None,
        )
        msgspec.msgpack.Decoder(made)  # a type that cannot be decoded is refused here
        return made

    def _field(self, name: str, field: FieldDescription, depth: int) -> Any:
        kind = self._type(field.type, depth)
        if kind in {int, float} and not (field.low is None and field.high is None):
            kind = Annotated[kind, msgspec.Meta(ge=field.low, le=field.high)]
        if field.required:
            return name, kind
        if not field.default:
            return name, kind | None, None
        try:
            default = _default(field.default, kind)
        except (msgspec.MsgspecError, ValueError, RecursionError):
            return name, kind | None, None  # a default that has no plain form
        if isinstance(default, list | dict):
            return name, kind, msgspec.field(default_factory=lambda: _default(field.default, kind))
        return name, kind, default

    def _type(self, text: str, depth: int) -> Any:
        try:
            # parsed, never evaluated: the text comes from another platform
            tree = ast.parse(text, mode="eval")
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise WireError(f"type {self._top}: {text[:80]!r} is not a type") from error
        return self._of(tree.body, depth)

    def _of(self, node: ast.expr, depth: int) -> Any:
        match node:
            case ast.Name(id=name) if name in self._described:
                return self._struct(name, depth + 1) or Any
            case ast.Name(id=name) if name in _SIMPLE:
                return _SIMPLE[name]
            case ast.Constant(value=None):
                return None
            case ast.Constant(value=str() | int() as value) if not isinstance(value, bool):
                return Literal[value]
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int(value))):
                return Literal[-value]
            case ast.BinOp(op=ast.BitOr()):
                return self._union(node, depth)
            case ast.Subscript(value=ast.Name(id=name), slice=inside) if name in {"list", "dict", "tuple"}:
                return self._container(name, inside, depth)
        raise WireError(f"type {self._top}: {ast.unparse(node)[:80]!r} is not a type")

    def _container(self, name: str, inside: ast.expr, depth: int) -> Any:
        parts = inside.elts if isinstance(inside, ast.Tuple) else [inside]
        endless = name == "tuple" and isinstance(parts[-1], ast.Constant) and parts[-1].value is ...
        kinds = [self._of(part, depth) for part in (parts[:-1] if endless else parts)]
        if name == "tuple":
            return tuple.__class_getitem__((*kinds, ...) if endless else tuple(kinds))
        if len(kinds) != (2 if name == "dict" else 1):
            raise WireError(f"type {self._top}: {name} of {len(kinds)} types")
        return list.__class_getitem__(kinds[0]) if name == "list" else dict.__class_getitem__(tuple(kinds))

    def _union(self, node: ast.expr, depth: int) -> Any:
        parts: list[Any] = []
        while isinstance(node, ast.BinOp):
            parts.insert(0, node.right)
            node = node.left
        kinds = [self._of(part, depth) for part in [node, *parts]]
        if str in kinds:  # an open vocabulary takes every text
            kinds = [kind for kind in kinds if kind is str or not _is_text(kind)]
        structs = [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, msgspec.Struct)]
        if Any in kinds or len(structs) > 1:
            return Any  # which Struct it is only the owner knows
        union: Any = kinds[0]
        for kind in kinds[1:]:
            union = union | kind if union is not None else kind | None
        return union


def _default(data: bytes, kind: Any) -> Any:
    return msgspec.convert(msgspec.msgpack.decode(data), kind)


def _is_text(kind: Any) -> bool:
    return getattr(kind, "__origin__", None) is Literal and isinstance(kind.__args__[0], str)
