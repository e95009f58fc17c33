"""Whether two records agree, within which tolerance and why; knows neither method."""
