"""Run what `to_mat` writes by the functions of the manual, in GNU Octave."""

import re
import shutil
import subprocess
from pathlib import Path

from scipy.io import loadmat, savemat

from alssnn.persistence import to_mat

ROOT = Path(__file__).parents[1]
COMMAND = "octave-cli"
NO_OCTAVE = "" if shutil.which(COMMAND) else f"no {COMMAND}"

# what a case is given decides on what is computed, one sample per row
SCRIPT = """
for i = 0:%d
    load(sprintf("model_%%d.mat", i)); given = load(sprintf("given_%%d.mat", i));
    after = []; output = []; sent = []; cut = []; u = [];
    if isfield(given, "x")
        n = columns(given.x);
        for k = 1:rows(given.x)
            du = given.u(k, :).' - model.u_offset;
            z = channels(model.lure, [given.x(k, :).'; du]);
            after(k, :) = z(1:n);
            output(k, :) = z(n + (1:numel(model.y_offset))) + model.y_offset;
        end
    end
    if isfield(given, "v")
        for k = 1:rows(given.v)
            [a, b] = law_alssnn(model, given.v(k, :).', given.s(k, :).', ...
                given.d(k, :).');
            sent(k, :) = a; cut(k, :) = b;
        end
    end
    if isfield(given, "r")
        x = zeros(model.lure.nx, 1); z = zeros(columns(model.K_z), 1);
        for k = 1:rows(given.r)
            [a, x, z] = control_alssnn(model, x, z, given.r(k, :).', ...
                given.y(k, :).', given.d(k, :).');
            u(k, :) = a;
        end
    end
    save("-v7", sprintf("found_%%d.mat", i), "after", "output", "sent", "cut", "u");
end
"""


def documented_functions(folder):
    """Copy the functions of the manual, which stand in the package."""
    text = (ROOT / "doc" / "files.rst").read_text(encoding="utf-8")
    shown = re.findall(r"literalinclude:: \.\./(\S+\.m)\n", text)
    assert len(shown) == 6
    for name in shown:
        shutil.copy(ROOT / name, folder)


def run(script, folder, timeout=300):
    """Run a script in a folder."""
    command = [COMMAND, "--norc", "--quiet", "--eval", script]
    options = {"capture_output": True, "text": True, "timeout": timeout}
    done = subprocess.run(command, cwd=folder, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


def compute(cases, folder):
    """Return what Octave finds for cases: pairs of (model, options) and what is given.

    Given are x and u of steps, v, s and d of a law, or r, y and d of a controller.
    """
    documented_functions(folder)
    for i, ((model, options), given) in enumerate(cases):
        to_mat(model, folder / f"model_{i}.mat", **options)
        savemat(folder / f"given_{i}.mat", given)
    run(SCRIPT % (len(cases) - 1), folder, timeout=1800)
    return [loadmat(folder / f"found_{i}.mat") for i in range(len(cases))]
