"""Making models of the volume tracker: simulated performances, training, reports."""
