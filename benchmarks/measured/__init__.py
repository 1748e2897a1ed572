"""Published measurements, simulated: a module and a file of measured points for each case."""
