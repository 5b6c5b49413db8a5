"""Names of signals."""

import re


def signal_names(names, letter="", size=0):
    """Return names of signals that python-control accepts.

    Parameters
    ----------
    names : sequence of str or None
        Names in the user's data, such as DataFrame columns.
    letter : str, default=""
        Letter of default names ``letter[0]``, ``letter[1]``, ...
    size : int, default=0
        Number of default names.

    Returns
    -------
    names : list of str
        One unique name per signal; "." means `system.signal` there and becomes "_".
    """
    if names is None:
        return [f"{letter}[{i}]" for i in range(size)]
    clean = [re.sub(r"\.", "_", str(name)) for name in names]
    unique: list[str] = []
    for i, name in enumerate(clean):
        if name in unique:
            name = f"{name}_{i}"
            while name in clean or name in unique:
                name += "_"
        unique.append(name)
    return unique
