"""Makes the models of the volume tracker."""
