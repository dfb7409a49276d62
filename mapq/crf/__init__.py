"""The conditional random field over plane patches: energy, graph cut, training, explanation."""

from mapq.crf.explain import Terms as Terms
from mapq.crf.explain import explain as explain
from mapq.crf.graph_cut import Labelling as Labelling
from mapq.crf.graph_cut import classify as classify
from mapq.crf.select import Trained as Trained
from mapq.crf.select import split_regions as split_regions
from mapq.crf.select import train as train
from mapq.crf.train import Strength as Strength
from mapq.crf.train import TrainingMap as TrainingMap
from mapq.crf.train import TrainSettings as TrainSettings
