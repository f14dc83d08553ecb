"""The checks of the region asked for, cheapest first."""
