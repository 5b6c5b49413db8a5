"""Run Structured Text from the parse tree of `blark`, with the numbers of a PLC.

The tree is turned into Python: a function block becomes a class whose instances hold
its variables, and arrays are lists. REAL is computed in single precision, an index
beyond an array is an error, and so is a name that differs from another one by the case
of its letters alone, for these are the same to a PLC.
"""

import functools
import math
import re

import blark.transform as tree
import numpy as np
from blark.parse import parse_source_code

OPERATORS = {"=": "==", "<>": "!=", "AND": "and", "OR": "or", "NOT": "not"}
UNIT = re.compile(r"^FUNCTION.*?^END_FUNCTION(?:_BLOCK)?$", re.M | re.S)
VALUES = re.compile(r"(\w+) (: ARRAY\[0\.\.\d+\] OF \w+) := \[(.*?)\];", re.S)


def read(text, whole=False):
    """Return the function blocks of a text, by their names.

    The parser takes long for long lists of numbers, so that the values of constants
    are read here and a block that differs in them alone is parsed once, unless `whole`
    asks for the text as it is.
    """
    single = "OF LREAL" not in text
    if whole:
        items = [(item, {}) for item in _parse(text)]
        return _Program(items, single, "REAL" if single else "LREAL").blocks
    items = []
    text = re.sub(r"\(\*.*?\*\)", "", text, flags=re.S).replace("LREAL", "REAL")
    for unit in UNIT.findall(text):
        constants = {name: words.split(",") for name, _, words in VALUES.findall(unit)}
        ((item),) = _parse(VALUES.sub(r"\1 \2;", unit))
        items.append((item, constants))
    return _Program(items, single, "REAL").blocks


@functools.cache
def _parse(text):
    result = parse_source_code(text)
    assert result.exception is None, result.exception
    return result.transform().items


class _Array(list):
    """An array whose indices are not counted from its end."""

    def __getitem__(self, i):
        assert i >= 0
        return super().__getitem__(i)

    def __setitem__(self, i, value):
        assert isinstance(i, slice) or i >= 0
        super().__setitem__(i, value)


class _Program:
    def __init__(self, items, single, number):
        kind = np.float32 if single else float
        self.kind, self.number = kind, number
        library = {
            "ABS": abs,
            "EXP": np.exp if single else math.exp,
            "SIN": np.sin if single else math.sin,
            "COS": np.cos if single else math.cos,
            "SEL": lambda g, a, b: b if g else a,
            "number": kind,
            "array": _Array,
        }
        self.scope = library
        for item, values in items:
            self.values = values
            exec(self.block(item), self.scope)
        names = [str(item.name) for item, _ in items]
        self.blocks = {name: self.scope[name] for name in names}

    def block(self, item):
        """Return a function or function block in Python."""
        is_function = isinstance(item, tree.Function)
        self.own, inputs, starts = {}, [], []
        constants = []
        if is_function:
            assert item.return_type.type.type == self.number
            self.declare(str(item.name))
            starts.append(f"{item.name} = number(0)")
        for group in item.declarations:
            kind = type(group).__name__
            for entry in group.items:
                for variable in entry.variables:
                    name = str(variable.variable.name)
                    self.declare(name)
                    start = self.start(entry.init, self.values.get(name))
                    if is_function and kind == "InputDeclarations":
                        inputs.append(name)
                    elif "CONSTANT" in str(group.attrs).upper():
                        constants.append((name, start))
                    else:
                        starts.append((name, start))
                    if kind == "InputDeclarations" and not is_function:
                        inputs.append(name)
                    elif kind == "InputOutputDeclarations":
                        inputs.append(f"&{name}")
        self.constants = {name for name, _ in constants}
        lines = self.body(item.body, 2)
        name = str(item.name)
        if is_function:
            plain = [s if isinstance(s, str) else f"{s[0]} = {s[1]}" for s in starts]
            body = "\n".join(["    " + s for s in plain] + self.body(item.body, 1))
            body = body.replace("self.", "")
            return f"def {name}({', '.join(inputs)}):\n{body}\n    return {name}\n"
        first = [f"        self.{n} = {s}" for n, s in [*constants, *starts]]
        takes = [f"        {self.take(word)}" for word in inputs]
        words = ", ".join(f"{word.strip('&')}=None" for word in inputs)
        return "\n".join(
            [
                f"class {name}:",
                "    def __init__(self):",
                *(first or ["        pass"]),
                f"    def __call__(self, {words}):",
                *takes,
                *lines,
                "        return self",
                "",
            ]
        )

    def take(self, word):
        """Return how an argument becomes a variable: by place, or its values."""
        name = word.strip("&")
        if word.startswith("&"):
            return f"assert {name} is not None; self.{name} = {name}"
        copy = f"array({name}) if isinstance({name}, list) else {name}"
        return f"self.{name} = self.{name} if {name} is None else {copy}"

    def declare(self, name):
        assert name.lower() not in self.own, f"{name} is declared twice"
        self.own[name.lower()] = name

    def start(self, init, words):
        """Return the value of a variable at the start."""
        if isinstance(init, tree.ArrayTypeInitialization):
            ((low, high),) = [(s.start, s.stop) for s in init.spec.subranges]
            assert low.value == "0"
            n, kind = int(high.value) + 1, str(init.spec.type.type_name)
            if words is not None:
                values = [self.literal(word.strip(), kind) for word in words]
            elif init.value is None:
                return f"array([{self.zero(kind)}] * {n})"
            else:
                values = [self.value(v) for v in self.elements(init.value)]
            assert len(values) == n
            return f"array([{', '.join(values)}])"
        kind = str(init.spec.type)
        return self.zero(kind) if init.value is None else self.value(init.value)

    def literal(self, word, kind):
        """Return a literal in Python, which must have the type of its array."""
        if kind == "DINT":
            return str(int(word))
        word = word.removeprefix(f"{self.number}#")
        assert re.fullmatch(r"-?\d+\.\d+(E[+-]?\d+)?", word), word
        return f"number({word})"

    def elements(self, value):
        if isinstance(value, tree.ArrayInitialization):
            return [e for v in value.elements for e in self.elements(v)]
        if isinstance(value, tree.ArrayInitialElement):
            assert value.count is None
            return self.elements(value.element)
        return [value]

    def zero(self, kind):
        known = {self.number: "number(0)", "BOOL": "False", "DINT": "0"}
        return known.get(kind) or f"{self.scope[kind].__name__}()"

    def body(self, body, depth):
        return [
            "    " * depth + line
            for statement in body.statements
            for line in self.statement(statement)
        ]

    def statement(self, s):
        if isinstance(s, tree.AssignmentStatement):
            (target,) = s.variables
            name = target if isinstance(target, tree.SimpleVariable) else target.name
            assert str(name.name) not in self.constants, f"{name} is constant"
            is_whole = isinstance(target, tree.SimpleVariable)
            value = self.value(s.expression)
            if is_whole:  # an array is copied, in its place
                name = self.value(target)
                yield f"value = {value}"
                yield f"if isinstance({name}, list):"
                yield f"    assert len({name}) == len(value)"
                yield f"    {name}[:] = value"
                yield "else:"
                yield f"    {name} = value"
            else:
                yield f"{self.value(target)} = {value}"
        elif isinstance(s, tree.ForStatement):
            by = "1" if s.step is None else self.value(s.step)
            low, high = self.value(s.from_), self.value(s.to)
            end = f"{high} + (1 if {by} > 0 else -1)"
            yield f"for {self.value(s.control)} in range({low}, {end}, {by}):"
            yield from self.body(s.statements, 1)
        elif isinstance(s, tree.IfStatement):
            yield f"if {self.value(s.if_expression)}:"
            yield from self.body(s.statements, 1)
            for clause in s.else_ifs:
                yield f"elif {self.value(clause.if_expression)}:"
                yield from self.body(clause.statements, 1)
            if s.else_clause:
                yield "else:"
                yield from self.body(s.else_clause.statements, 1)
        elif isinstance(s, tree.ExitStatement):
            yield "break"
        elif isinstance(s, tree.FunctionCallStatement):
            yield self.call(s)
        else:
            raise NotImplementedError(type(s).__name__)

    def call(self, s):
        words = [
            (f"{p.name.name}=" if p.name else "") + self.value(p.value)
            for p in s.parameters
        ]
        name = str(s.name.name)
        name = f"self.{self.own[name.lower()]}" if name.lower() in self.own else name
        return f"{name}({', '.join(words)})"

    def value(self, e):
        """Return an expression in Python."""
        if isinstance(e, tree.Real):
            assert e.type_name == self.number, f"{e} has no type"
            return f"number({e.value})"
        if isinstance(e, tree.Integer):
            return str(e.value)
        if isinstance(e, tree.Boolean):
            return str(e.value).title()
        if isinstance(e, tree.ParenthesizedExpression):
            return f"({self.value(e.expr)})"
        if isinstance(e, tree.UnaryOperation):
            return f"({OPERATORS.get(str(e.op), str(e.op))} {self.value(e.expr)})"
        if isinstance(e, tree.BinaryOperation):
            op = OPERATORS.get(str(e.op), str(e.op))
            return f"({self.value(e.left)} {op} {self.value(e.right)})"
        if isinstance(e, tree.FunctionCall):
            return self.call(e)
        if isinstance(e, tree.SimpleVariable):
            return f"self.{self.own[str(e.name).lower()]}"
        if isinstance(e, tree.MultiElementVariable):
            text = self.value(e.name)
            for element in e.elements:
                if isinstance(element, tree.SubscriptList):
                    (place,) = element.subscripts
                    text += f"[{self.value(place)}]"
                else:
                    text += f".{element.field.name}"
            return text
        raise NotImplementedError(type(e).__name__)
