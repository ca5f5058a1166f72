"""One loss per file. Rows i and i + m of a batch of 2m are of the same place."""
