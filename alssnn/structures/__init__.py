"""Structures: maps from named parameters to the Lur'e form.

A structure is declared by its equations, not programmed.  It consists of

    sizes       axis name -> length; an axis is a block of rows or columns of Theta
    updates     x+ of every axis of states, a signal
    layers      what every axis of neurons sees, a signal
    signals     signals with a name: outputs, the virtual input, what a cost penalizes
    parameters  name -> axes, for example  B: ("x", "u"),  b_y: ("w_h",)

and everything else follows: the flat vector theta, Theta itself, its derivative,
the change of units.  A signal is a sum of terms  F_1 F_2 ... F_m  times the columns of
an axis (`Signal`); its factors are parameters and constants, also transposed or as
diagonals, and the last one may be a vector computed from several parameters (`AtRest`:
biases tied so that g and k vanish at the operating point).  Named signals in a term are
put in their place, so that every term adds a product to one block of Theta.  The
derivative of a term is the product rule.
Acting on the regressor phi of one sample (see `simulation`), a term contributes

    P F_i S phi[cols],        P = F_1 ... F_(i-1),   S = F_(i+1) ... F_m

so that the derivative by F_i[a, b] is  P[:, a] (S phi[cols])[b]  (eq. sens).
`direct` tabulates these gains and signals once for all samples, and `pull` goes the
other way, from a gradient by Theta to one by theta; nothing ever forms
d Theta / d theta as a dense array.  A parameter may stand in any number of terms:
their derivatives add up.

Which signals are channels is a matter of the view: `Structure.observe` takes others,
and `Structure.law` makes the static map (s, u) -> v of the virtual input.
"""

from ._direct import direct, pull
from ._signals import ONE, AtRest, Diagonal, Factor, Matrix, Signal, Term, diagonal
from ._structure import Structure

__all__ = [
    "ONE",
    "AtRest",
    "Diagonal",
    "Factor",
    "Matrix",
    "Signal",
    "Structure",
    "Term",
    "diagonal",
    "direct",
    "pull",
]
