"""IPOPT on generated C where a compiler is found, else on CasADi's interpreter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi

from posture_opt.model.c_source import c_text
from posture_opt.model.compiled import library_of

IPOPT_OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",  # no banner
    "print_time": False,
    "calc_lam_p": False,  # the multipliers of the parameters cost one more evaluation and nobody reads them
}


def compiled_nlp(
    nlp: Mapping[str, Any],
    options: Mapping[str, Any] | None = None,
    *,
    name: str = "solver",
    compiled: bool | None = None,
) -> casadi.Function:
    """IPOPT on an NLP whose objective, constraints and derivatives are generated C.

    The library is found by the NLP itself, so that a cached one costs neither derivatives nor code generation.

    Args:
        nlp: CasADi's ``x``, ``p``, ``f``, ``g``.
        options: of ``nlpsol``, over :data:`IPOPT_OPTIONS`.
        compiled: None compiles where a C compiler is found, else interprets; False never; True or an error.

    Raises:
        InputError: ``compiled=True`` and nothing could be compiled.
    """
    settings = {**IPOPT_OPTIONS, **(options or {})}
    # Only these change the functions that IPOPT asks for; a new tolerance must not compile anew.
    kept = ("ipopt.hessian_approximation",)
    structure = {key: settings[key] for key in sorted(settings) if not key.startswith("ipopt.") or key in kept}
    oracle = casadi.Function("nlp", dict(nlp), ["x", "p"], ["f", "g"])

    def source() -> str:
        solver = casadi.nlpsol("solver", "ipopt", dict(nlp), structure)
        return c_text([solver.oracle(), *(solver.get_function(key) for key in solver.get_function())])

    library, _ = library_of(compiled, lambda: f"{oracle.serialize()}{structure}", source)
    if library is None:
        return casadi.nlpsol(name, "ipopt", dict(nlp), settings)
    settings.pop("expand", None)
    return casadi.nlpsol(name, "ipopt", str(library.path), settings)
