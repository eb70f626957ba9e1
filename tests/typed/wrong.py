"""Calls with wrong types: mypy finds a fault in each line that ends with ``# wrong``, and in no other."""

import roughvol
from roughvol.analysis.accessor import Accessor

ds = roughvol.open("rubber")
roughvol.open(3)  # wrong
roughvol.open("rubber", change={"surface.m": 6})  # wrong
roughvol.press([[0.0, 1.0]], L=[100.0])  # wrong
roughvol.press([[0.0, 1.0]], L=100.0, steps="five")  # wrong
roughvol.press([[0.0, 1.0]], L=100.0, nu="0.5")  # wrong
roughvol.press([[0.0, 1.0]], 100.0)  # wrong
roughvol.run(study=12)  # wrong
roughvol.run("study.yaml", jobs="all")  # wrong
roughvol.load("study.yaml").cases[0]  # wrong
roughvol.show("rubber", 0.5)  # wrong
roughvol.show("rubber").frames()  # wrong
roughvol.compare(["dry", "wet"], [0.5, 1.0])  # wrong
roughvol.card("gasket.yaml").cards[0]  # wrong
roughvol.ask("gasket", leak_rate=["1 mm^3/s"])  # wrong
roughvol.ask("gasket", unknown="hardness")  # wrong
roughvol.creep("gasket", "creep.yaml", at="pressure=1 MPa")  # wrong
roughvol.creep("gasket", 0.1, at="pressure=1 MPa", times="1 s")  # wrong
roughvol.plot("rubber", figure=5)  # wrong
roughvol.check("study.yaml").cost  # wrong
roughvol.explain("helium").gas.viscosity  # wrong
roughvol.tradeoff()  # wrong
Accessor(ds).at(pressure=["0.5 MPa"])  # wrong
Accessor(ds).mean(over=1)  # wrong
area: int = roughvol.contact.HalfSpace  # wrong
