"""The card of the gpu tests: a software adapter, or with the marker ``gpu`` a graphics card."""

from ...cards import opened_gpu  # noqa: F401 a fixture of each test here
