"""The first hour."""
import click
from roughvol.cli.group import main


@main.command()
def init(): ...


@main.command()
def explain(): ...
