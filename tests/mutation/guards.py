"""What keeps which source from mistakes: the quick tests that run on its altered copy, uncompiled."""

from __future__ import annotations

from typing import NamedTuple


class Guard(NamedTuple):
    """A source, and what has to fail when it is wrong.

    Attributes
    ----------
    module : str
    tests : tuple of str
        Arguments of pytest, quickest first; it stops at the first failure.
    moves : tuple of str
        Moves of the sampler whose ratios and draws are checked besides, before the tests, as `tests/kernels` does on
        more maps (tests.mutation.ratios).
    borders : bool
        Whether comparisons that differ at equality alone are altered: labels tie, coordinates do not.
    """

    module: str
    tests: tuple[str, ...]
    moves: tuple[str, ...] = ()
    borders: bool = False


CRF = "tests/mapq/crf"
PROBLEM = tuple(
    f"{CRF}/test_train.py::{test}"
    for test in (
        "test_the_objective_is_the_pseudo_likelihood_by_its_definition",
        "test_gradient_and_hessian_are_the_differences",
        "test_those_problems_meet_every_face_of_the_box",
        "test_separable_labels_give_finite_weights",
        "test_the_optimum_is_found_where_a_whole_step_goes_too_far",
        "test_the_optimum_is_that_of_a_generic_solver",
    )
)
CUT = tuple(
    f"{CRF}/test_infer.py::{test}"
    for test in (
        "test_without_coupling_a_patch_has_its_own_sign",
        "test_energies_are_rounded_to_a_fine_unit_or_to_what_the_flow_has_room_for",
        "test_a_coupling_of_one_unit_couples",
        "test_huge_energies_do_not_overflow",
        "test_almost_nothing",
        "test_only_wanted_differences_are_computed_and_they_are_the_same",
        "test_a_negative_coupling_is_refused_before_the_cut",
        "test_numbers_that_are_none_are_refused",
        "test_the_order_of_patches_and_pairs_changes_nothing",
        "test_the_cut_is_the_best_of_all_labellings_ties_to_suspicious[0]",
        "test_differences_are_those_of_all_labellings[0]",
    )
)
MARGIN = tuple(
    f"{CRF}/test_margin.py::{test}"
    for test in (
        "test_a_patch_alone_is_a_support_vector_machine",
        "test_a_part_scores_labels_as_the_definition_does_with_0_for_no_label",
        "test_pairs_without_weights_of_a_coupling_have_none",
        "test_the_bias_alone_is_as_weak_as_documented",
        "test_the_search_ends_within_a_thousandth_of_the_optimum_or_after_300_rounds",
        "test_the_bound_holds_however_rough_the_program_is",
        "test_the_optimum_is_the_same_in_other_units",
        "test_the_cut_finds_the_labelling_that_breaks_the_margin_most",
        "test_no_weights_are_better_than_the_bound_says",
        "test_a_wrong_label_costs_what_its_class_is_short_of",
        "test_too_few_rounds_are_said",
    )
)
ONE_MAP = f"{CRF}/test_margin.py::test_labels_that_weigh_nothing_to_tell_still_train"
TRAIN = tuple(
    f"{CRF}/test_train.py::{test}"
    for test in (
        "test_labels_that_cannot_train_are_refused",
        "test_settings_that_would_train_something_else_are_refused",
        "test_one_label_alone_and_no_map_at_all_are_refused",
        "test_no_coupling_may_be_negative",
        "test_the_bias_of_nodes_has_no_prior_and_the_coupling_one_of_its_own",
        "test_the_field_has_the_columns_asked_for_each_once",
        "test_both_labels_weigh_alike_unless_asked_otherwise",
        "test_an_unlabelled_patch_counts_as_label_zero_for_its_neighbours",
        "test_the_objective_is_the_pseudo_likelihood_by_its_definition",
        "test_labels_too_few_for_folds_still_train",
        "test_pseudo_likelihood_is_highest_at_the_weights_found",
        "test_there_are_five_folds_unless_asked_otherwise",
    )
)
SONAR = (
    "tests/sensors/test_domain.py",
    *(
        f"tests/sensors/test_sonar.py::{test}"
        for test in (
            "test_parameters_without_a_density_are_refused",
            "test_the_slow_twin_has_the_same_defaults",
            "test_cones_leave_the_window_where_shapely_says",
            "test_a_sonar_reaches_up_to_where_its_cone_leaves_the_window",
            "test_fields_of_view_that_are_none_are_refused",
            "test_too_many_slots_are_refused",
            "test_no_edges",
            "test_every_wall_and_corner_finds_room",
            "test_without_sonar_no_cone_is_touched",
            "test_a_new_chain_has_room_for_edges_that_come_and_has_asked_no_cone_for_a_proposal",
            "test_slots_hold_every_cell_that_a_cone_enters",
            "test_somebody_or_nobody_returns_the_pulse",
            "test_the_index_loses_nothing[large-room]",
            "test_the_index_loses_nothing[small-room]",
        )
    ),
)
LASER = (
    "tests/sensors/test_domain.py",
    "tests/sensors/test_laser_layout.py",
    *(
        f"tests/sensors/test_laser.py::{test}"
        for test in (
            "test_parameters_without_a_density_are_refused",
            "test_weights_that_leave_nothing_for_hits_are_refused",
            "test_rays_along_the_axes_leave_exactly",
            "test_rays_keep_readings_and_reach",
            "test_a_reading_beyond_the_window_is_censored_at_its_border",
            "test_no_beams_and_no_edges",
        )
    ),
)
NEAR_THE_WAY = tuple(
    f"tests/test_recompute.py::{test}"
    for test in (
        "test_twins_agree_when_edges_may_come_near_the_way[prior-7.0]",
        "test_twins_agree_when_edges_may_come_near_the_way[prior-1.0]",
        "test_no_edge_ever_comes_near_a_way_that_is_hard",
    )
)
UNSEEN = "tests/sampler/test_prior_ground.py"
KERNELS = "tests/kernels"
BY_HAND = (f"{KERNELS}/test_few_edges.py", f"{KERNELS}/test_refused.py")
SMALLEST = f"{KERNELS}/test_smallest_maps.py"
OF_MOVES = {
    **dict.fromkeys(
        ("bend", "interior_triangle", "lean", "move_vertex", "notch", "notch_shape", "recolor", "split_edge"), BY_HAND
    ),
    "cut_wall": (SMALLEST,),
    "join_wall": (SMALLEST,),
    "move_line": (f"{KERNELS}/test_move_line.py",),
    "placing": (
        f"{KERNELS}/test_proposal_draws.py::test_sides_come_in_proportion_to_their_lengths",
        f"{KERNELS}/test_proposal_draws.py::test_near_a_corner_is_a_reach_from_it_along_each_side",
    ),
}
"""What is asked besides the ratios and draws of moves: maps made by hand, as chains do not meet everything."""
GROUPS: dict[str, tuple[Guard, ...]] = {
    "crf": (
        Guard("mapq.crf.energy", (f"{CRF}/test_energy.py",), borders=True),
        Guard("mapq.crf.likelihood", PROBLEM, borders=True),
        Guard("mapq.crf.infer", CUT, borders=True),
        Guard("mapq.crf.marginals", (f"{CRF}/test_marginals.py",), borders=True),
        Guard("mapq.crf.scaling", (f"{CRF}/test_scaling.py",), borders=True),
        Guard("mapq.crf.quadratic", (f"{CRF}/test_quadratic.py",), borders=True),
        Guard("mapq.crf.margin", MARGIN, borders=True),
        Guard("mapq.crf.calibrate", (f"{CRF}/test_calibrate.py",), borders=True),
        Guard("mapq.crf.train", (*TRAIN, *MARGIN, ONE_MAP), borders=True),
    ),
    "likelihoods": (
        Guard("prf.kernels.laser", ("tests/kernels/test_laser.py",)),
        Guard("prf.kernels.sonar", ("tests/kernels/test_sonar.py",)),
        Guard("prf.kernels.points", ("tests/kernels/test_points.py",)),
        Guard("prf.sensors.laser", LASER),
        Guard("prf.sensors.sonar", SONAR),
        Guard("prf.sensors.points", ("tests/sensors/test_points.py", "tests/kernels/test_points.py")),
    ),
    "ground": (
        Guard("prf.driven", ("tests/test_driven.py",)),
        Guard("prf.kernels.prior_ground", (f"{UNSEEN}::test_steps_there_leave_every_likelihood_to_the_last_bit",)),
        Guard(
            "prf.kernels.guards",
            (
                "tests/test_driven.py::test_guards_hold_the_pieces_in_every_cell_that_they_come_near",
                *NEAR_THE_WAY,
                f"{UNSEEN}::test_steps_there_leave_every_likelihood_to_the_last_bit[laser]",
                "tests/sampler/test_tiles.py::test_each_beam_is_decided_by_one_tile[0]",
            ),
        ),
    ),
    "hastings": tuple(
        Guard(f"prf.kernels.moves.{name}", OF_MOVES.get(name, ()), moves)
        for name, moves in (
            ("interior_triangle", ("triangle birth", "triangle death")),
            ("boundary_triangle", ("boundary birth", "boundary death")),
            ("corner_cut", ("corner birth", "corner death")),
            ("split_edge", ("split", "merge")),
            ("move_vertex", ("move interior", "move boundary", "past corner", "slide")),
            ("recolor", ("recolor", "local recolor", "cut wall")),
            ("cut_wall", ("cut wall", "mend wall")),
            ("join_wall", ("join wall", "part wall")),
            ("gap", ("cut wall", "mend wall", "join wall", "part wall")),
            ("dock", ("dock", "undock")),
            ("notch", ("notch", "fill")),
            ("notch_shape", ("notch", "fill")),
            ("move_line", ("move line",)),
            ("lean", ("lean", "stand")),
            ("bend", ("bend", "unbend")),
            ("placing", ("boundary birth", "corner birth", "past corner", "triangle birth", "move boundary", "split")),
        )
    ),
}
