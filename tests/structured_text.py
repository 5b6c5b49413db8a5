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
FIRST = 900_001  # what integers are called in parts that are parsed once
INTEGER = re.compile(r"(?<![\w.#])(?<!E[+-])\d+(?![\w.])|(?<=\.\.)\d+")
VALUES = re.compile(r"(\w+) (: ARRAY\[0\.\.\d+\] OF \w+) := \[(.*?)\];", re.S)


def read(text, whole=False):
    """Return the function blocks of a text, by their names.

    The parser takes a millisecond per character, so that values of constants are read
    here, and declarations and statements that differ in integers alone are parsed once,
    unless `whole` asks for the text as it is.
    """
    single = "OF LREAL" not in text
    if whole:
        units = [_Unit.of_item(item) for item in _parse(text)]
        return _Program(units, single, "REAL" if single else "LREAL").blocks
    text = re.sub(r"\(\*.*?\*\)", "", text, flags=re.S).replace("LREAL", "REAL")
    units = [_Unit.of_text(unit) for unit in UNIT.findall(text)]
    return _Program(units, single, "REAL").blocks


@functools.cache
def _parse(text):
    result = parse_source_code(text)
    assert result.exception is None, result.exception
    return result.transform().items


class _Unit:
    """Hold a function or function block, in parts whose integers have other names.

    A part is a group of declarations or a statement, beside a dict of its integers.
    """

    def __init__(self, item, declarations, statements, constants):
        self.name, self.is_function = str(item.name), isinstance(item, tree.Function)
        self.type = item.return_type.type.type if self.is_function else None
        self.declarations, self.statements = declarations, statements
        self.constants = constants

    @classmethod
    def of_item(cls, item):
        groups, statements = item.declarations, item.body.statements
        return cls(item, [(g, {}) for g in groups], [(s, {}) for s in statements], {})

    @classmethod
    def of_text(cls, text):
        constants = {name: words.split(",") for name, _, words in VALUES.findall(text)}
        first, *lines, last = VALUES.sub(r"\1 \2;", text).splitlines()
        (item,) = _parse(f"{first}\n{last}")
        declarations, statements, group, part = [], [], "", []
        for line in lines:
            if re.match("VAR", line):
                group = line
            elif line == "END_VAR":
                group = ""
            elif group:
                one, integers = cls.part(f"{group}\n{line}\nEND_VAR")
                declarations += [(d, integers) for d in one.declarations]
            else:
                part.append(line)
                if re.match(r"\S.*; *$", line):  # a statement ends where none is inside
                    one, integers = cls.part("\n".join(part))
                    statements += [(s, integers) for s in one.body.statements]
                    part = []
        assert not group and not any(part)
        return cls(item, declarations, statements, constants)

    @staticmethod
    def part(text):
        integers = {}

        def named(match):
            name = str(FIRST + len(integers))
            integers[name] = match[0]
            return name

        text = INTEGER.sub(named, text)
        (item,) = _parse(f"FUNCTION_BLOCK part\n{text}\nEND_FUNCTION_BLOCK")
        return item, integers


class _Array(list):
    """An array whose indices are not counted from its end."""

    def __getitem__(self, i):
        assert i >= 0
        return super().__getitem__(i)

    def __setitem__(self, i, value):
        assert isinstance(i, slice) or i >= 0
        super().__setitem__(i, value)


class _Program:
    def __init__(self, units, single, number):
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
        for unit in units:
            exec(self.block(unit), self.scope)
        self.blocks = {unit.name: self.scope[unit.name] for unit in units}

    def block(self, unit):
        """Return a function or function block in Python."""
        self.own, self.values, is_function = {}, unit.constants, unit.is_function
        inputs, starts, constants = [], [], []
        if is_function:
            assert unit.type == self.number
            self.declare(unit.name)
            starts.append(f"{unit.name} = number(0)")
        for group, self.integers in unit.declarations:
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
        name, lines = unit.name, []
        for statement, self.integers in unit.statements:
            lines += [
                f"{'    ' * (2 - is_function)}{s}" for s in self.statement(statement)
            ]
        if is_function:
            plain = [s if isinstance(s, str) else f"{s[0]} = {s[1]}" for s in starts]
            body = "\n".join(["    " + s for s in plain] + lines)
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
            n, kind = int(self.value(high)) + 1, str(init.spec.type.type_name)
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
            return self.integers.get(str(e.value), str(e.value))
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
