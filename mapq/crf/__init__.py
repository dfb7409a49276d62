"""The conditional random field over plane patches: score, training, inference, explanation."""

from mapq.crf.classify import Labelling as Labelling
from mapq.crf.classify import classify as classify
from mapq.crf.explain import Terms as Terms
from mapq.crf.explain import explain as explain
from mapq.crf.explain import local_log_odds as local_log_odds
from mapq.crf.regions import split_regions as split_regions
from mapq.crf.select import HeldOut as HeldOut
from mapq.crf.select import Trained as Trained
from mapq.crf.select import train as train
from mapq.crf.train import Strength as Strength
from mapq.crf.train import TrainingMap as TrainingMap
from mapq.crf.train import TrainSettings as TrainSettings
from mapq.model import Model as Model
