"""The conditional random field over plane patches: energy, graph cut, training, explanation.

Here is what labels a map; :func:`mapq.crf.cross_validation.train` fits a model.
"""

from mapq.crf.explain import Terms as Terms
from mapq.crf.explain import explain as explain
from mapq.crf.graph_cut import Labelling as Labelling
from mapq.crf.graph_cut import classify as classify
