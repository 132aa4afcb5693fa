"""Samples of FMUs and loops leave out no kind, and in turn nothing at all."""

import sample


def test_each_sample_has_one_fmu_of_each_kind_and_in_turn_all_are_met() -> None:
    samples = [sample.one_of_each_kind(number) for number in range(200)]
    kinds = {len(names) for names in samples}
    assert kinds == {len(set(samples[0]))} and {name for names in samples for name in names} == set(sample.FMU_NAMES)


def test_three_samples_have_all_loops() -> None:
    assert sorted(loop for number in range(3) for loop in sample.every_third_loop(number)) == sample.LOOP_NAMES


def test_39_samples_have_each_part_of_the_tests_with_each_third_of_the_loops() -> None:
    samples = range(3 * sample.PARTS)
    assert len({(sample.part_of_tests(number), *sample.every_third_loop(number)) for number in samples}) == len(samples)
