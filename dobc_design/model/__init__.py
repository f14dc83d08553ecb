"""The equations of the paper: as CasADi functions, in SymPy, as float64 arrays and in LaTeX."""
