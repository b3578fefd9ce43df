"""Slow, plain, float64 twins of what mvtn does fast; only tests import them."""
