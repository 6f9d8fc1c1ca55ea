"""What is real in lab and simulation: wheels, contacts, the infrared ring."""
