(** Each theorem, said of a run of the witness of three axes: none is about nothing. *)
From Coq Require Import ZArith List Bool Lia.
From Composition Require Import Rows Runs Witness.
Import ListNotations.
Open Scope Z_scope.

Module Of := Runs OfThree.
Import OfThree Of.

(** Nothing of the theorems is left to assume. *)
Definition three : N = 3%nat \/ N = 6%nat := or_introl eq_refl.

Definition here := {| nominal_in_force := 0; offsets_in_force := fun _ => 0 |}.
Definition told is_latched := {| in_force := fun _ => here; stop_latched := is_latched |}.
Definition on_time (is_stop is_rearm : bool) := {|
  reading := Some (fun _ => (0, 0)); at_stop := is_stop; at_quit := false; at_rearm := is_rearm; elapsed := 1 |}.
Definition hears what :=
  {| fate := Taken; events := map (fun event => (7%nat, event)) what; epochs := tt; cycle := on_time false false |}.
Definition silent := hears [].
Definition stopped :=
  {| fate := Taken; events := []; epochs := tt; cycle := on_time true false |}.
Definition pressed :=
  {| fate := Taken; events := []; epochs := tt; cycle := on_time false true |}.

(** The tick that the witness makes of an input; the drives take its references. *)
Definition out_of w input := snd (tick tt (server w) (fate input) (events input) (epochs input) (cycle input)).
Definition after w input :=
  let s := fst (tick tt (server w) (fate input) (events input) (epochs input) (cycle input)) in
  {| server := s; drives := demanded s; took := negb (is_withheld (out_of w input)) |}.
Definition plays w inputs := fold_left after inputs w.

Lemma after_is_a_tick : forall w input, truthful w (fate input) -> one_tick tt w input (after w input) (out_of w input).
Proof.
  intros w input truth. split; [exact truth|]. unfold after, out_of. split.
  - destruct (tick tt (server w) (fate input) (events input) (epochs input) (cycle input)). reflexivity.
  - simpl. intros taken. split; [|intros i _; auto].
    apply negb_true_iff. exact taken.
Qed.

Definition begun is_latched := {|
  server := match start tt (told is_latched) with Some s => s | None => {|
    discrete := blank Fault false; axes := fun _ => rest_at here; withheld := true; off_path := true; paced := false;
    noted := 0 |} end;
  drives := fun _ => here; took := true |}.
Lemma begun_is_started : forall is_latched, started tt (told is_latched) (begun is_latched).
Proof. intros is_latched. split; [reflexivity|]. intros i _. auto. Qed.

(** Every world of these runs is one of a run. *)
Fixpoint all_taken w (inputs : list Input) : bool :=
  match inputs with
  | [] => true
  | input :: rest => (match fate input with Taken => took w | _ => false end) && all_taken (after w input) rest
  end.
Lemma plays_is_a_run : forall inputs w, run tt w -> all_taken w inputs = true -> run tt (plays w inputs).
Proof.
  induction inputs as [|input rest rests]; intros w ran taken; [exact ran|].
  simpl in taken. apply andb_prop in taken as [taken all].
  apply (rests (after w input)); auto. eapply goes_on; [exact ran|]. apply after_is_a_tick.
  unfold truthful. destruct (fate input); auto; discriminate.
Qed.

(** Every tick of a run has a property: computed, one tick after the other. *)
Ltac ticks := cbn [all_ticks]; repeat (split; [solve [repeat split; vm_compute; auto] |];
  eexists; eexists; split; [apply after_is_a_tick; vm_compute; reflexivity |]); reflexivity.
Ltac a_run := apply plays_is_a_run; [eapply begins, begun_is_started | vm_compute; reflexivity].
Ltac computed := vm_compute; repeat split; auto; discriminate.

(** A session that has asked for authority, and follows. *)
Definition to_listening := plays (begun false) [silent].
Definition to_handshake := plays (begun false) [silent; hears [Hello]].
Definition to_submit := plays (begun false) [silent; hears [Hello]; hears [Command 1 ToSubmit 0]].
Definition asks := hears [Command 2 ToObtain 20].
Definition follows := hears [Command 3 ToObtain 20].
Definition in_obtain := plays (begun false)
  [silent; hears [Hello]; hears [Command 1 ToSubmit 0]; hears [Command 2 ToObtain 20]].
Definition after_a_miss := after in_obtain silent.
Definition on_the_ramp := plays in_obtain [follows; hears [Command 4 ToObtain 20]; silent; silent].
(** A path that is far away. *)
Definition far := {| fate := Taken; events := []; epochs := tt; cycle := {|
  reading := Some (fun _ => (5000, 0)); at_stop := false; at_quit := false; at_rearm := false; elapsed := 1 |} |}.

Lemma a_run_to_listening : run tt to_listening. Proof. a_run. Qed.
Lemma a_run_to_handshake : run tt to_handshake. Proof. a_run. Qed.
Lemma a_run_to_submit : run tt to_submit. Proof. a_run. Qed.
Lemma a_run_to_obtain : run tt in_obtain. Proof. a_run. Qed.
Lemma a_run_to_the_ramp : run tt on_the_ramp.
Proof. apply plays_is_a_run; [exact a_run_to_obtain | vm_compute; reflexivity]. Qed.
Lemma the_first : (0 < N)%nat. Proof. vm_compute. auto. Qed.

Lemma a_step : one_tick tt in_obtain follows (after in_obtain follows) (out_of in_obtain follows).
Proof. apply after_is_a_tick. computed. Qed.
(** It moves by its S, and is written. *)
Example moves : is_withheld (out_of in_obtain follows) = false /\
  count (channels (axes (server (after in_obtain follows)) 0) Position) = 20 /\
  count (channels (axes (server in_obtain) 0) Position) = 10.
Proof. computed. Qed.

Definition of_validity := every_state_is_valid three tt in_obtain a_run_to_obtain.
Definition of_T1_T2_T3 := T1_T2_T3_no_offset_jumps three tt in_obtain follows _ _ 0%nat Position
  a_run_to_obtain a_step the_first.
Definition of_T3 := T3_reference_moves_no_further three tt in_obtain follows _ _ 0%nat a_run_to_obtain a_step the_first.
Definition of_T21_jumps := T21_drives_never_jump three tt in_obtain follows _ _ 0%nat
  a_run_to_obtain a_step (proj1 moves) the_first.
Definition of_T21_unknown := T21_unknown_is_not_written three tt in_obtain follows _ _
  a_run_to_obtain a_step (proj1 moves).

Lemma a_second_step : one_tick tt (after in_obtain follows) silent (after (after in_obtain follows) silent)
  (out_of (after in_obtain follows) silent).
Proof. apply after_is_a_tick. computed. Qed.
Definition of_T2 := T2_over_three_states three tt in_obtain follows _ _ silent _ _ 0%nat Position
  a_run_to_obtain a_step a_second_step eq_refl eq_refl the_first.

(** T4: two misses; and one, with a command after it. *)
Definition of_T4_second := T4_second_miss_ramps three tt in_obtain silent _ _ silent _ _ a_run_to_obtain
  (after_is_a_tick in_obtain silent ltac:(computed)) (after_is_a_tick after_a_miss silent ltac:(computed))
  ltac:(computed) ltac:(computed) ltac:(computed) ltac:(computed) ltac:(computed).
Definition of_T4_one := T4_one_miss_is_tolerated three tt in_obtain silent _ _ follows _ _ a_run_to_obtain
  (after_is_a_tick in_obtain silent ltac:(computed)) (after_is_a_tick after_a_miss follows ltac:(computed))
  ltac:(computed) ltac:(computed) ltac:(computed) ltac:(computed) ltac:(computed)
  ltac:(computed) ltac:(computed) ltac:(computed) ltac:(computed) ltac:(computed).

(** T5: a ramp from 10 to 0 in a step. *)
Definition of_T5_exact := T5_exact three tt on_the_ramp silent _ _ 0%nat Position a_run_to_the_ramp
  (after_is_a_tick on_the_ramp silent ltac:(computed)) ltac:(computed) ltac:(computed) the_first.
Definition of_T5_ends := T5_ramp_ends three tt [silent] on_the_ramp (plays on_the_ramp [silent])
  a_run_to_the_ramp ltac:(computed) ltac:(ticks) 0%nat Position the_first.

(** T6, T21: a session is granted. *)
Definition of_T6 := T6_T21_granted_at_zero three tt to_listening (hears [Hello]) _ _ a_run_to_listening
  (after_is_a_tick to_listening (hears [Hello]) ltac:(computed)) ltac:(computed) ltac:(computed).

(** T7: a stranger's command and Goodbye beside the owner's command. *)
Definition crowded := {| fate := Taken; epochs := tt; cycle := on_time false false;
  events := [(8%nat, Command 9 ToObtain 0); (7%nat, Command 3 ToObtain 20); (8%nat, Goodbye)] |}.
Definition of_T7 := T7_others_decide_nothing three eq_refl tt in_obtain crowded a_run_to_obtain ltac:(computed).
Example others_are_left_out : filter (is_owners (settled tt in_obtain crowded)) (events crowded) = events follows.
Proof. reflexivity. Qed.

(** T27: a forgery at the owner's connection, and a stranger's command; the same bytes with the tag. *)
Definition with_tag tag := OverDatagrams 5%nat (tag, Command 3 ToObtain 20).
Definition forged := [(7%nat, with_tag 4%nat); (8%nat, with_tag 5%nat)].
Definition hears_forged := {|
  fate := Taken; events := events_of forged; epochs := tt; cycle := on_time false false |}.
Lemma owners_are_forged : forall from arrival, In (from, arrival) forged ->
  owner (discrete (settled tt in_obtain hears_forged)) = Some from -> is_forged arrival.
Proof.
  intros from arrival [is_it | [is_it | []]]; inversion is_it; subst; intros owns; vm_compute in owns |- *;
    [reflexivity | discriminate].
Qed.
Definition of_T27 := T27_forgeries_decide_nothing three eq_refl tt in_obtain hears_forged forged
  a_run_to_obtain ltac:(computed) eq_refl owners_are_forged.
Example a_tag_is_heard : events_of [(7%nat, with_tag 5%nat)] = events follows.
Proof. reflexivity. Qed.

(** T9: a stop at the machine; servers that start latched. *)
Definition of_T9_stop := T9_a_stop_is_not_forgotten three tt in_obtain stopped _ _ [silent; silent]
  (plays (after in_obtain stopped) [silent; silent]) a_run_to_obtain
  (after_is_a_tick in_obtain stopped ltac:(computed)) ltac:(computed) ltac:(ticks).
Definition of_T9_latch := T9_latch_outlives_the_server three tt (told true) (begun true) [silent; silent]
  (plays (begun true) [silent; silent]) (begun_is_started true) eq_refl ltac:(ticks).
Definition of_T9_stuck := T9_a_stuck_rearm_leads_nowhere three tt (told true) (begun true) [pressed; pressed]
  (plays (begun true) [pressed; pressed]) (begun_is_started true) eq_refl ltac:(ticks).

(** T21: a path that is far away is a fault, and a server that starts waits for it. *)
Definition of_T21_path := T21_path_is_waited_for three tt in_obtain far _ _ 0%nat a_run_to_obtain
  (after_is_a_tick in_obtain far ltac:(computed)) ltac:(computed) the_first ltac:(computed).
Definition of_T21_start := T21_a_start_waits_for_its_path three tt (told false) (begun false) far _ _ 0%nat
  (begun_is_started false) (after_is_a_tick (begun false) far ltac:(computed)) eq_refl ltac:(computed) the_first.

(** T22: silence, from a session that follows and from one that waits for its first command. *)
Definition of_T22_silence := T22_silence_ends_in_listening three tt [silent; silent; silent; silent] in_obtain
  (plays in_obtain [silent; silent; silent; silent]) 2 a_run_to_obtain ltac:(computed)
  (fun _ _ _ => ltac:(simpl; lia)) ltac:(lia) ltac:(simpl; lia) ltac:(ticks).
Definition of_T22_handshake := T22_handshake_ends_in_listening three tt [silent; silent; silent] to_handshake
  (plays to_handshake [silent; silent; silent]) a_run_to_handshake ltac:(computed) ltac:(simpl; lia) ltac:(ticks).

(** T23: a grant, and a command that acts. *)
Definition of_T23_grant := T23_epochs_never_repeat three eq_refl tt to_listening (hears [Hello]) _ _
  a_run_to_listening (after_is_a_tick to_listening (hears [Hello]) ltac:(computed)).
Definition of_T23_command := T23_epochs_never_repeat three eq_refl tt in_obtain follows _ _ a_run_to_obtain a_step.
Example acts : is_live (discrete (server (after to_listening (hears [Hello])))) = true /\
  epoch (discrete (server (after in_obtain follows))) = epoch (discrete (server in_obtain)) /\
  action (decision tt in_obtain follows) = Follow.
Proof. computed. Qed.
(** The same command again, two ticks later: it is not heard, and the next one is. *)
Definition again := plays in_obtain [follows; asks].
Definition of_T23_recorded := T23_a_recorded_frame_acts_no_more three eq_refl tt [asks]
  (after in_obtain follows) again (hears [Command 4 ToObtain 20])
  (goes_on tt _ _ _ _ a_run_to_obtain a_step) ltac:(ticks).
Example is_not_heard_again : command (facts tt (after in_obtain follows) follows) = None /\
  command (facts tt again (hears [Command 4 ToObtain 20])) = Some (4%nat, ToObtain) /\
  epoch (discrete (server again)) = epoch (discrete (server (after in_obtain follows))).
Proof. computed. Qed.

(** T33: two ticks of Obtain whose second differences are counted. *)
Definition first_of_obtain := and_then tt 0%nat to_submit 0 0 to_submit asks _ _
  (at_first tt 0%nat to_submit ltac:(computed)) (after_is_a_tick to_submit asks ltac:(computed)) eq_refl ltac:(computed).
Definition second_of_obtain := and_then tt 0%nat to_submit 1 _ (after to_submit asks) follows _ _
  first_of_obtain (after_is_a_tick (after to_submit asks) follows ltac:(computed)) eq_refl ltac:(computed).
Definition of_T33 := T33_agitation_is_bounded three tt 0%nat to_submit 2 _ _ 10 a_run_to_submit the_first
  second_of_obtain eq_refl ltac:(computed).

(** An axis without a budget, asked to move. *)
Definition shaken := plays in_obtain [hears [Command 3 ToObtain 10]].
Definition of_T33_end := T33_beyond_the_budget_it_ends three tt shaken follows _ _ 2%nat
  ltac:(apply plays_is_a_run; [exact a_run_to_obtain | vm_compute; reflexivity])
  (after_is_a_tick shaken follows ltac:(computed)) ltac:(computed) ltac:(vm_compute; auto) ltac:(computed).

(** A loop at 25 um/s, without a permit, then without an actual value: 15, 5, 0. *)
Definition of_T18 := T18_a_loop_stands_in_time tt [(false, true); (true, false); (false, false)] (25, false)
  ltac:(unfold loop_valid; simpl; lia) ltac:(intros input [is_so | [is_so | [is_so | []]]]; subst; simpl; auto).
Example a_loop_stands :
  map (fun n => velocity (fold_left (loop_tick tt) (firstn n [(false, true); (true, false); (false, false)]) (25, false)))
    [1; 2; 3]%nat = [15; 5; 0].
Proof. reflexivity. Qed.

(** Of the witness the theorems rest on nothing. *)
Definition theorems := (
  every_state_is_valid,
  T1_T2_T3_no_offset_jumps,
  T2_over_three_states,
  T3_reference_moves_no_further,
  T4_second_miss_ramps,
  T4_one_miss_is_tolerated,
  T5_exact,
  T5_ramp_ends,
  T6_T21_granted_at_zero,
  T7_others_decide_nothing,
  T9_a_stop_is_not_forgotten,
  T9_latch_outlives_the_server,
  T9_a_stuck_rearm_leads_nowhere,
  T18_a_loop_stands_in_time,
  T21_drives_never_jump,
  T21_unknown_is_not_written,
  T21_path_is_waited_for,
  T21_a_start_waits_for_its_path,
  T22_silence_ends_in_listening,
  T22_handshake_ends_in_listening,
  T23_epochs_never_repeat,
  T23_a_recorded_frame_acts_no_more,
  T27_forgeries_decide_nothing,
  T33_agitation_is_bounded,
  T33_beyond_the_budget_it_ends).
Print Assumptions theorems.
