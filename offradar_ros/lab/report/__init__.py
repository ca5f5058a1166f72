"""A report of an evaluation, with the tables and figures of the paper."""
