"""Registration: coherent point drift, Laplacian completion, articulated fit, rigid alignment."""
