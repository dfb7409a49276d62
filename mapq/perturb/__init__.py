"""Labelled maps from posed scans: merged as they are, or with known errors of their poses."""

from mapq.perturb.build import Built as Built
from mapq.perturb.build import build as build
from mapq.perturb.errors import PoseErrors as PoseErrors
from mapq.perturb.errors import displaced as displaced
from mapq.perturb.label import Rule as Rule
