"""A report of an evaluation: what the paper's tables and figures say, of what was measured."""
