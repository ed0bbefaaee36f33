"""The reason why a branch, a curve or a walk ended."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Ending:
    """Why something ended: ``str()`` gives the sentence, code asks for the kind.

    Attributes
    ----------
    kind : str
        "interval" (the end of what was asked for), "closed", "bound", "vanishes" (the motion shrinks to nothing),
        "contact" (the motion no longer reaches one), "onset" (a curve of folds meets one of Hopf points), "family" (the
        parameter does not vary), "homoclinic" (the period grows without limit), "began" (nothing lies before), "shown"
        (there is more), "stuck", "beyond" (an unknown has left every scale), "points" (as many as were asked for),
        "unresolved" (by the harmonics), "limit" (the time allowed is over); empty where it is not known.
    what : str
        What happened, a sentence without its full stop.
    advice : str
        What to try, likewise; empty where there is nothing to be done.
    """

    kind: str = ""
    what: str = ""
    advice: str = ""

    @property
    def complete(self) -> bool:
        """Whether it is the end of what there was to follow: what lies beyond was not lost."""
        return self.kind not in ("stuck", "points", "unresolved", "limit", "")

    def __str__(self) -> str:
        return f"{self.what}; {self.advice}" if self.advice else self.what
