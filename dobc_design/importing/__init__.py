"""Problems from files of other programs: power grids, lists of arcs.  Nothing in them is ever
executed."""
