"""Run Modelica from the parse tree of `pymoca`.

Functions become functions of Python, whose arrays are those of NumPy, counted from 1 as
in Modelica. A sampled block becomes an object that is called once per sample: the
equations of its `when` are evaluated in their order, with ``pre(x)`` as the old x.
"""

import functools
import itertools
import math
import operator

import numpy as np
from pymoca import ast, parser

BINARY = {
    "+": operator.add,
    "-": operator.sub,
    "/": operator.truediv,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
}
BUILTIN = {
    "abs": abs,
    "tanh": math.tanh,
    "sin": math.sin,
    "cos": math.cos,
    "exp": math.exp,
    "min": min,
    "max": max,
    "zeros": np.zeros,
}
TYPES = {"Real": float, "Integer": int, "Boolean": bool}


def read(text):
    """Return the package of a text."""
    tree = parser.parse(text)
    assert tree is not None, "not Modelica"
    (name,) = [n for n, each in tree.classes.items() if each.type == "package"]
    package = tree.classes[name]
    return Package(name, package)


def product(a, b):
    """Return the product as Modelica has it: of matrices, of vectors, by a scalar."""
    return a @ b if np.ndim(a) and np.ndim(b) else a * b


class Package:
    """Hold functions and blocks of a package, by their names."""

    def __init__(self, name, package):
        self.name, self.constants = name, {}
        for symbol in package.symbols.values():
            self.constants[symbol.name] = self.initial(symbol, {})
        kinds = {"function": Function, "block": Block}
        self.members = {
            key: kinds[each.type](self, each)
            for key, each in package.classes.items()
            if each.type in kinds
        }

    def __getitem__(self, name):
        return self.members[name]

    def __contains__(self, name):
        return name in self.members

    def initial(self, symbol, scope):
        """Return what a symbol is at the start: its value, or an array of its sizes."""
        arguments = symbol.class_modification
        for argument in arguments.arguments if arguments else ():
            if argument.value.component.name == "value":
                (value,) = argument.value.modifications
                value = self.value(value, scope)
                assert np.shape(value) == self.sizes(symbol, scope), symbol.name
                return value
        kind, sizes = TYPES.get(symbol.type.name, float), self.sizes(symbol, scope)
        return np.full(sizes, math.nan if kind is float else 0, kind) if sizes else None

    def sizes(self, symbol, scope):
        every = [self.value(d, scope) for ds in symbol.dimensions for d in ds]
        return tuple(size for size in every if size is not None)

    def value(self, node, scope):
        """Return the value of an expression."""
        if isinstance(node, bool):
            return node
        if isinstance(node, ast.Primary):
            return node.value
        if isinstance(node, ast.Array):
            return np.array([self.value(each, scope) for each in node.values])
        if isinstance(node, ast.ComponentRef):
            whole = (
                scope[node.name] if node.name in scope else self.constants[node.name]
            )
            places = self.places(node, scope)
            return whole[places] if places else whole
        if isinstance(node, ast.IfExpression):
            for condition, value in itertools.zip_longest(
                node.conditions, node.expressions, fillvalue=True
            ):
                if self.value(condition, scope):
                    return self.value(value, scope)
        return self.operation(node, scope)

    def operation(self, node, scope):
        if isinstance(node.operator, ast.ComponentRef):
            name = node.operator.name
            if name == "pre":
                return scope["pre"][node.operands[0].name]
            values = [self.value(each, scope) for each in node.operands]
            function = BUILTIN[name] if name in BUILTIN else self.members[name]
            return function(*values)
        if node.operator in ("and", "or"):
            decides = node.operator == "or"
            for each in node.operands:
                if self.value(each, scope) is decides:
                    return decides
            return not decides
        values = [self.value(each, scope) for each in node.operands]
        if node.operator == "not":
            return not values[0]
        if len(values) == 1:
            return -values[0] if node.operator == "-" else values[0]
        do = product if node.operator == "*" else BINARY[node.operator]
        value = functools.reduce(do, values)
        return bool(value) if isinstance(value, np.bool_) else value

    def places(self, node, scope):
        """Return the indices of a reference, counted from 0; none of a whole."""
        found = []
        for index in node.indices[0]:
            if isinstance(index, ast.Slice):
                start, stop = (
                    self.value(index.start, scope),
                    self.value(index.stop, scope),
                )
                assert self.value(index.step, scope) == 1  # the parser mistakes others
                found.append(slice(start - 1, stop))
            elif index is not None:
                place = self.value(index, scope)
                assert place >= 1, f"{node.name}[{place}]"
                found.append(place - 1)
        return tuple(found)


class Function:
    """Hold a function, called with the values of its inputs."""

    def __init__(self, package, item):
        self.package, self.item = package, item
        every = item.symbols.values()
        self.inputs = [s.name for s in every if "input" in s.prefixes]
        self.outputs = [s.name for s in every if "output" in s.prefixes]
        self.symbols = {s.name: s for s in every}
        fixed = [s for s in every if "constant" in s.prefixes]
        self.constants = {s.name: package.initial(s, {}) for s in fixed}
        given = {*self.inputs, *self.constants}
        self.start = {
            name: package.initial(symbol, {})
            for name, symbol in self.symbols.items()
            if name not in given
        }
        self.shapes = {n: package.sizes(s, {}) for n, s in self.symbols.items()}

    def __call__(self, *values):
        scope = dict(self.constants)
        scope |= {n: np.copy(v) if np.ndim(v) else v for n, v in self.start.items()}
        for name, value in zip(self.inputs, values, strict=True):
            assert np.shape(value) == self.shapes[name], (self.item.name, name)
            scope[name] = np.copy(value) if np.ndim(value) else value
        self.run(self.item.statements, scope)
        found = tuple(scope[name] for name in self.outputs)
        return found if len(found) > 1 else found[0]

    def run(self, statements, scope):
        value = self.package.value
        for each in statements:
            if isinstance(each, ast.AssignmentStatement):
                self.assign(each.left, value(each.right, scope), scope)
            elif isinstance(each, ast.IfStatement):
                for condition, block in zip(each.conditions, each.blocks, strict=False):
                    if value(condition, scope):
                        self.run(block, scope)
                        break
            elif isinstance(each, ast.ForStatement):
                (index,) = each.indices
                span = index.expression
                assert value(span.step, scope) == 1  # the parser mistakes others
                assert index.name not in scope, "a name of a loop hides another one"
                for i in range(value(span.start, scope), value(span.stop, scope) + 1):
                    scope[index.name] = i
                    self.run(each.statements, scope)
                scope.pop(index.name, None)
            else:
                assert isinstance(each, ast.WhileStatement), each
                while value(each.condition, scope):
                    self.run(each.statements, scope)

    def assign(self, targets, result, scope):
        results = result if len(targets) > 1 else (result,)
        for target, value in zip(targets, results, strict=True):
            name, places = target.name, self.package.places(target, scope)
            assert name in self.symbols and name not in self.inputs, name
            if places:
                whole = scope[name]
                assert np.shape(whole[places]) == np.shape(value), name
                whole[places] = value
            else:
                assert np.shape(value) == self.shapes[name], (self.item.name, name)
                scope[name] = np.copy(value) if np.ndim(value) else value


class Block:
    """Hold a sampled block; an instance is called with its inputs at every sample."""

    def __init__(self, package, item):
        self.package, self.item = package, item
        every = item.symbols.values()
        kinds = {"RealInput": "inputs", "RealOutput": "outputs"}
        for kind, place in kinds.items():
            setattr(self, place, [s.name for s in every if s.type.name == kind])
        (when,) = item.equations
        (condition,), (self.equations,) = when.conditions, when.blocks
        assert condition.operator.name == "sample"
        assert condition.operands[1].name == "dt"

    def __call__(self):
        return Instance(self)


class Instance:
    def __init__(self, block):
        self.block, package = block, block.package
        self.values = {}
        for symbol in block.item.symbols.values():
            is_parameter = "parameter" in symbol.prefixes
            value = package.initial(symbol, self.values) if is_parameter else None
            start = self.start(symbol)
            sizes = package.sizes(symbol, {})
            if start is not None:
                value = np.full(sizes, package.value(start, self.values), dtype=float)
            if value is not None:
                self.values[symbol.name] = value

    def start(self, symbol):
        arguments = symbol.class_modification
        for argument in arguments.arguments if arguments else ():
            if argument.value.component.name == "start":
                return argument.value.modifications[0]
        return None

    def __call__(self, **inputs):
        block = self.block
        assert set(inputs) == set(block.inputs)
        before = dict(self.values)
        scope = {**self.values, **inputs, "pre": before}
        for equation in block.equations:
            value = block.package.value(equation.right, scope)
            left = equation.left
            many = isinstance(left, list)
            for target, part in zip(
                left if many else [left], value if many else [value], strict=True
            ):
                scope[target.name] = self.values[target.name] = part
        return self
