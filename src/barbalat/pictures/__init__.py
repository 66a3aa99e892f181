"""Plots as data, and their drawing: panels over time, responses over frequency. It knows neither runs nor certificates."""
