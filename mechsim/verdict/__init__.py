"""Says whether two records agree, within which bound and why; knows neither road."""
