"""The structures over which the tests run."""

from alssnn.models import state_space

# (nx, nu, ny) of every shape, options of `state_space`, channels
STRUCTURES = {
    "linear": ((3, 2, 2), {}, "y"),
    "linear-siso": ((2, 1, 1), {}, "y"),
    "more outputs than states": ((1, 1, 3), {}, "y"),
    "fl": ((3, 2, 2), {"n_h": 4}, "y"),
    "gr": ((3, 2, 2), {"n_g": 3, "tied_bias": False}, "y"),
    "al": ((3, 2, 2), {"n_h": 4, "n_g": 3}, "yg"),
    "al-siso": ((2, 1, 1), {"n_h": 2, "n_g": 2}, "yg"),
    "al-unpenalized": ((3, 1, 2), {"n_h": 2, "n_g": 3}, "y"),
    "fl-state": ((3, 2, 1), {"n_h": 4, "feedback": "state"}, "y"),
    "al-output": ((3, 2, 2), {"n_h": 4, "n_g": 3}, "ye"),
    "al-state-output": ((2, 1, 1), {"n_h": 2, "n_g": 3, "feedback": "state"}, "ye"),
    "fl-split": ((3, 2, 2), {"n_h": 4}, "yh"),
    "al-split": ((3, 2, 1), {"n_h": 2, "n_g": 3, "feedback": "state"}, "yeh"),
    "al-free-bias": ((3, 2, 1), {"n_h": 2, "n_g": 3, "tied_bias": False}, "yg"),
    "linear-feedthrough": ((2, 2, 3), {"feedthrough": True}, "y"),
    "penalized h": ((2, 2, 1), {"n_h": 3, "n_g": 2}, "yh"),
    "odd": ((3, 1, 2), {"n_h": (3, 2), "odd": True, "activation": "sin"}, "y"),
    "nonlinear output": ((3, 2, 2), {"n_h": 3, "n_k": 2, "feedthrough": True}, "yk"),
    "deep": (
        (3, 2, 1),
        {
            "n_h": (2, 3),
            "n_g": (3, 4, 2),
            "n_k": (2, 2),
            "activation": {"h": "sigmoid", "g": "tanh", "k": "sin"},
        },
        "ygk",
    ),
    "deep-state-output": (
        (2, 2, 3),
        {
            "n_h": (2, 2),
            "n_g": (2, 3),
            "n_k": 2,
            "feedback": "state",
            "feedthrough": True,
            "tied_bias": False,
            "activation": {"h": "relu", "g": "sigmoid", "k": "identity"},
        },
        "yekh",
    ),
    "monotone": ((3, 2, 2), {"n_h": 3, "input_map": "monotone"}, "y"),
    "monotone-state": (
        (2, 1, 1),
        {"n_h": (2, 3), "n_g": 2, "feedback": "state", "input_map": "monotone"},
        "yeh",
    ),
    "monotone-odd": (
        (3, 2, 1),
        {
            "n_h": 2,
            "n_g": 2,
            "n_k": 2,
            "feedback": "state",
            "odd": True,
            "input_map": "monotone",
        },
        "yg",
    ),
}
FIRST_EDITION = [name for name in STRUCTURES if not name.startswith("monotone")]


def declare(name, rng):
    """Return a structure of the list, with a random C if it is fixed."""
    (nx, nu, ny), options, channels = STRUCTURES[name]
    has_network = {"n_h", "n_g", "n_k"} & set(options)
    C = rng.standard_normal((ny, nx)) if has_network else None
    return state_space(nx, nu, ny, C=C, **options).observe(*channels)
