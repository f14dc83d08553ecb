"""Problems from files of other programs: power grids, MATLAB, lists of arcs.  Nothing in them is ever executed."""
