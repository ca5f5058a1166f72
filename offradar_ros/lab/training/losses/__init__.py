"""One loss a file. Rows i and i + m of a batch of 2m are one place."""
