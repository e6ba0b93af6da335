"""What every room may use: errors, units, files, caches, the terminal, and the contract of generated modules."""
