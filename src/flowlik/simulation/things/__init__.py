"""What worlds are furnished with: plants, rocks, buildings, vehicles; each drawn anew from a generator."""
