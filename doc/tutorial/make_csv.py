"""Write doc/tutorial/arm.csv, the record of the tutorial: a simulated pendulum.

By ``python doc/tutorial/make_csv.py``. The angle has white noise of 1 % of its standard
deviation, and all columns are rounded as a data logger would do.
"""

from pathlib import Path

import numpy as np

from alssnn.datasets import make_pendulum

OUT = Path(__file__).with_name("arm.csv")
N_SAMPLES = 2_400  # two minutes


def main():
    """Simulate the arm and write the file."""
    record = make_pendulum(N_SAMPLES, amplitude=4.5, noise=0.01, random_state=0)
    time = record.dt * np.arange(N_SAMPLES)
    columns = np.column_stack([time, record.u, record.y])
    formats = ["%.2f", "%.3f", "%.4f"]
    header = "time,torque,angle"
    np.savetxt(OUT, columns, fmt=formats, delimiter=",", header=header, comments="")


if __name__ == "__main__":
    main()
