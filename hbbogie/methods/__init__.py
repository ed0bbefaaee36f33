"""Methods: each turns a system into algebraic equations for its cycles."""
