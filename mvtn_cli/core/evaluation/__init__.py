"""How good a trained recogniser is, as pure functions of arrays, and the one call that judges a run."""
