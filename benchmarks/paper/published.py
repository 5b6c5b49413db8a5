"""What the paper prints, table by table, in its units; None where it prints nothing."""

# Root-mean-square errors (training, test): volts, and units of x3.
RMSE = {
    "wh": {
        "LTI": (2.7e-2, 2.8e-2),
        "GR-SSNN": (3.6e-4, 3.7e-4),
        "AL-SSNN": (5.3e-4, 5.5e-4),
    },
    "prey": {
        "LTI": (1.9, 1.9),
        "GR-SSNN": (6.7e-2, 6.5e-2),
        "AL-SSNN": (9.5e-2, 9.3e-2),
    },
}

# Open loop: (max, mean) of |g|/|Ax+Bu|, where g is f for GR-SSNN, then of |h|/|Ax+Bu|.
OPEN_LOOP = {
    "wh": {
        "GR-SSNN": (0.45, 0.20, None, None),
        "AL-SSNN": (3.6e-3, 1.9e-4, 1.2, 5.6e-2),
    },
    "prey": {
        "GR-SSNN": (5.01, 0.75, None, None),
        "AL-SSNN": (0.85, 2.5e-2, 25.16, 1.00),
    },
}

# Wiener-Hammerstein: (error, mean of |g|/|Ax+Bu|) by gamma.
GAMMA = {0.01: (2.8e-4, 5.6e-3), 1: (5.5e-4, 1.9e-4), 100: (7.1e-3, 1.9e-5)}

# Closed loop of AL-SSNN: (max, mean) of |Ax+Bv|, of |omega|, of their ratio.
CLOSED_LOOP = {
    "wh": {"AL-SSNN": (8.6, 1.9, 5.3e-3, 2.7e-4, 4.1e-3, 2.0e-4)},
    "prey": {"AL-SSNN": (2.07, 0.75, 7.8e-2, 1.4e-2, 0.71, 0.13)},
}

# Wiener-Hammerstein: phi, psi, extreme eigenvalues of P, eps, psi eps^2 / phi.
CERTIFICATE = {"AL-SSNN": (0.1, 11.0, 2e-2, 1.5, 5.3e-3, 3.1e-4)}

# (gamma, iterations, training time in minutes)
TRAINING = {
    "wh": {"GR-SSNN": (None, 500, 40.3), "AL-SSNN": (1.0, 500, 123.0)},
    "prey": {"GR-SSNN": (None, 1000, 19.4), "AL-SSNN": (2.0, 1000, 36.9)},
}
