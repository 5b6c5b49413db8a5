"""Options of estimators, declared once: default, constraint and description together.

An estimator is a dataclass of its options.  A class declares those that it adds and
describes them in its docstring; from these `estimator` derives the constructor, the
constraints that scikit-learn checks, and the complete docstring, in which everything
that its bases describe stands as well.
"""

import inspect
from dataclasses import dataclass, field, fields

SECTIONS = ("Parameters", "Attributes")


menu = dataclass(init=False, eq=False, repr=False)  # options that estimators inherit


def option(default, constraint, *, kw_only=True, doc=None):
    """Declare an option of an estimator.

    Parameters
    ----------
    default : object
        Its default.
    constraint : list or str
        What scikit-learn checks, see `sklearn.utils._param_validation`.
    kw_only : bool, default=True
        Whether it must be named in a call.
    doc : list of str or None, default=None
        Description in the form of numpydoc; None takes that of the docstrings.

    Returns
    -------
    option : dataclasses.Field
        Member of the body of an estimator.
    """
    metadata = {"constraint": constraint, "doc": doc}
    return field(default=default, kw_only=kw_only, metadata=metadata)


def take(menu, name, *, kw_only=True):
    """Return an option that another class has declared and described.

    Parameters
    ----------
    menu : type
        Class with options; it need not be a base.
    name : str
        Name of the option.
    kw_only : bool, default=True
        Whether it must be named in a call.

    Returns
    -------
    option : dataclasses.Field
        Member of the body of an estimator.
    """
    given = vars(menu).get("__dataclass_fields__", vars(menu))[name]
    doc = _items(menu.__doc__, "Parameters").get(name)
    return option(given.default, given.metadata["constraint"], kw_only=kw_only, doc=doc)


def estimator(cls):
    """Make constructor, constraints and docstring of an estimator from its options.

    Parameters
    ----------
    cls : type
        Class with options, and with the options of its bases.

    Returns
    -------
    cls : type
        The same class.
    """
    cls = dataclass(eq=False, repr=False)(cls)
    own = _in_reading_order(cls)
    cls._parameter_constraints = {
        name: option.metadata["constraint"] for name, option in own.items()
    }
    signature = inspect.signature(cls.__init__)
    arguments = [
        signature.parameters[name].replace(annotation=inspect.Parameter.empty)
        for name in ("self", *own)
    ]
    cls.__init__.__signature__ = inspect.Signature(arguments)
    cls.__doc__ = _complete(cls, own)
    return cls


def _in_reading_order(cls):
    """Return the options: positional ones, then those of the class and of its bases."""
    declared = [inspect.get_annotations(base) for base in cls.__mro__]
    depth = {
        name: max(i for i, names in enumerate(declared) if name in names)
        for names in declared
        for name in names
    }
    named = {option.name: option for option in fields(cls)}
    order = sorted(named, key=lambda n: depth[n] if named[n].kw_only else -1)
    return {name: named[name] for name in order}


def _complete(cls, options):
    """Return the docstring of a class with all that its bases describe."""
    doc = cls.__doc__
    if doc is None:  # python -OO
        return None
    described: dict[str, dict] = {section: {} for section in SECTIONS}
    for base in reversed(cls.__mro__):
        for section in SECTIONS:
            own = _items(base.__dict__.get("__doc__"), section)
            described[section] |= own
    parameters = {
        name: described["Parameters"].get(name) or option.metadata["doc"] or [name]
        for name, option in options.items()
    }
    # what a class says of its own stays where it says it
    own = _items(doc, "Parameters")
    parameters |= {name: text for name, text in own.items() if name in parameters}
    head, rest = _split(doc)
    blocks = {"Parameters": parameters, "Attributes": described["Attributes"]}
    sections = [
        line
        for section, items in blocks.items()
        for line in (
            section,
            "-" * len(section),
            *(line for item in items.values() for line in item),
            "",
        )
    ]
    return "\n".join([*head, *sections, *rest])


def _split(doc):
    """Return the lines before the sections of a docstring, and the other sections."""
    lines = inspect.cleandoc(doc).splitlines()
    heads = _heads(lines)
    start = heads[0][0] if heads else len(lines)
    stops = [*(i for i, _ in heads[1:]), len(lines)]
    rest = [
        line
        for (i, name), stop in zip(heads, stops, strict=True)
        if name not in SECTIONS
        for line in lines[i:stop]
    ]
    before = lines[:start]
    return before if before and not before[-1] else [*before, ""], rest


def _items(doc, section):
    """Return the items of a section of a docstring: name to lines."""
    lines = inspect.cleandoc(doc or "").splitlines()
    heads = _heads(lines)
    places = [i for i, (_, name) in enumerate(heads) if name == section]
    if not places:
        return {}
    (place,) = places
    stop = heads[place + 1][0] if place + 1 < len(heads) else len(lines)
    items: dict[str, list[str]] = {}
    name = None
    for line in lines[heads[place][0] + 2 : stop]:
        if line and not line.startswith(" "):
            name = line.split(" : ")[0]
            items[name] = []
        if name is not None and line:
            items[name].append(line)
    return items


def _heads(lines):
    """Return place and name of every section."""
    return [
        (i, line)
        for i, line in enumerate(lines[:-1])
        if line and set(lines[i + 1]) == {"-"}
    ]
