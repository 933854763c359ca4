"""The method's steps, in the order of the paper's outline (Fig. 3)."""
