"""What many devices cost, before there are any: a cost model, and a simulation of placement."""
