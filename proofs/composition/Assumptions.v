(** What every theorem rests on: rows, and what has a prefix. `prove composition` reads it. *)
From Composition Require Import Rows Runs.

Declare Module R : ROWS.
Module OfRows := Runs R.
Import OfRows.

Print Assumptions every_state_is_valid.
Print Assumptions T1_T2_T3_no_offset_jumps.
Print Assumptions T2_over_three_states.
Print Assumptions T3_reference_moves_no_further.
Print Assumptions T4_second_miss_ramps.
Print Assumptions T4_one_miss_is_tolerated.
Print Assumptions T5_exact.
Print Assumptions T5_ramp_ends.
Print Assumptions T6_T21_granted_at_zero.
Print Assumptions T7_others_decide_nothing.
Print Assumptions T9_a_stop_is_not_forgotten.
Print Assumptions T9_latch_outlives_the_server.
Print Assumptions T9_a_stuck_rearm_leads_nowhere.
Print Assumptions T18_a_loop_stands_in_time.
Print Assumptions T21_drives_never_jump.
Print Assumptions T21_unknown_is_not_written.
Print Assumptions T21_path_is_waited_for.
Print Assumptions T21_a_start_waits_for_its_path.
Print Assumptions T22_silence_ends_in_listening.
Print Assumptions T22_handshake_ends_in_listening.
Print Assumptions T23_epochs_never_repeat.
Print Assumptions T23_a_recorded_frame_acts_no_more.
Print Assumptions T27_forgeries_decide_nothing.
Print Assumptions T33_agitation_is_bounded.
Print Assumptions T33_beyond_the_budget_it_ends.
