"""Labelled maps from posed scans: merged as they are, or with known errors of their poses."""

from mapq.perturb.build import Built as Built
from mapq.perturb.build import build as build
from mapq.perturb.errors import displaced as displaced
