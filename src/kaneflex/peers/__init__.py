"""Other programs that solve the same scenes by formulations of their own, to compare with."""
