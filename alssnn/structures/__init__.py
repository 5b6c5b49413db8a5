"""Structures: maps from named parameters to the Lur'e form.

A structure is declared, not programmed.  It consists of

    sizes       axis name -> length; an axis is a block of rows or columns of Theta
    states, channels, neurons   which axes make up x, z and w, in order
    parameters  name -> axes, for example  B: ("x", "u"),  b_y: ("w_h",)
    terms       Term(rows, cols, factors):  Theta[rows, cols] += F_1 F_2 ... F_m

and everything else follows: the flat vector theta, Theta itself, its derivative,
the change of units.  The factors of a term are parameters and constants; the last may
be a vector computed from several parameters (`networks.AtRest`: biases tied so that g
and k vanish at the operating point).  The derivative of a term is the product rule.
Acting on the regressor phi of one sample (see `simulation`), a term contributes

    P F_i S phi[cols],        P = F_1 ... F_(i-1),   S = F_(i+1) ... F_m

so that the derivative by F_i[a, b] is  P[:, a] (S phi[cols])[b]  (eq. sens).
`Structure.direct` tabulates these gains and signals once for all samples; nothing ever
forms d Theta / d theta as a dense array.
"""

from ._state_space import state_space_structure
from ._structure import Structure

__all__ = ["Structure", "state_space_structure"]
