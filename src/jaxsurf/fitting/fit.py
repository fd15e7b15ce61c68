"""Fit: what every fit returns, and what it may be believed to say.

Two errors stand beside each value. The statistical one says how far the value would move on another
set of surfaces; the systematic one how far it moves when the analyst's choices (window, smallest
size, correction terms) change. They are never added in silence; `total_error` adds them in
quadrature.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, repr=False)
class Fit:
    """Fitted values with their errors, goodness of fit and status.

    Attributes:
        model: what was fitted, in words: "power law of mean_length".
        values: parameter -> value.
        stderr: parameter -> statistical standard error (over surfaces).
        systematic: parameter -> spread over windows, sizes or correction terms; absent if unknown.
        covariance: statistical covariance, rows in the order of `values`.
        chi2: weighted sum of squared residuals, with the covariance of the data.
        dof: degrees of freedom.
        status: "converged", or what went wrong and what to do about it.
        details: window, sizes, scheme, bootstrap draws: whatever it takes to redo the fit.
        notes: what a reader must know to believe the errors, one sentence each.
    """

    model: str
    values: Mapping[str, float]
    stderr: Mapping[str, float]
    covariance: Float[np.ndarray, "parameter parameter"]
    chi2: float
    dof: int
    systematic: Mapping[str, float] = field(default_factory=dict)
    status: str = "converged"
    details: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def converged(self) -> bool:
        """Whether the values may be used at all."""
        return self.status == "converged"

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters, in the order of `covariance`."""
        return tuple(self.values)

    @property
    def p_value(self) -> float:
        """Chance of a chi2 at least this large if the model holds; 1 without degrees of freedom."""
        from scipy.special import chdtrc  # a fifth of a second that `import jaxsurf` can spare

        return float(chdtrc(self.dof, self.chi2)) if self.dof > 0 else 1.0

    def total_error(self, name: str) -> float:
        """Statistical and systematic error of one parameter, added in quadrature."""
        return float(np.hypot(self.stderr[name], self.systematic.get(name, 0.0)))

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and strings, ready for JSON."""
        return {
            "model": self.model,
            "status": self.status,
            "values": {k: float(v) for k, v in self.values.items()},
            "stderr": {k: float(v) for k, v in self.stderr.items()},
            "systematic": {k: float(v) for k, v in self.systematic.items()},
            "covariance": np.asarray(self.covariance).tolist(),
            "chi2": float(self.chi2),
            "dof": int(self.dof),
            "details": {k: _plain(v) for k, v in self.details.items()},
            "notes": list(self.notes),
        }

    def __repr__(self) -> str:
        lines = [f"Fit({self.model}: {self.status}; chi2 {self.chi2:.4g} / {self.dof})"]
        width = max(map(len, self.names), default=0)
        for name in self.names:
            line = f"  {name:<{width}} = {self.values[name]:.5g} ± {self.stderr[name]:.2g}"
            if name in self.systematic:
                line += f" (statistical) ± {self.systematic[name]:.2g} (systematic)"
            lines.append(line)
        return "\n".join([*lines, *(f"  note: {note}" for note in self.notes)])

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{name}</td><td>{self.values[name]:.5g}</td><td>{self.stderr[name]:.2g}</td>"
            f"<td>{f'{self.systematic[name]:.2g}' if name in self.systematic else ''}</td></tr>"
            for name in self.names
        )
        return (
            f"<div><b>{self.model}</b>: {self.status}; "
            f"&chi;&sup2; {self.chi2:.4g} / {self.dof}"
            f"{''.join(f'<br>{note}' for note in self.notes)}"
            "<table><thead><tr><th></th><th>value</th><th>statistical</th><th>systematic</th></tr>"
            f"</thead><tbody>{rows}</tbody></table></div>"
        )


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(v) for v in value]
    return value
