(** Runs of the witness of three axes, one for the premises of each theorem: none holds of nothing. *)
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
Lemma plays_are_ticks : forall (holds_at : World -> Input -> Prop) inputs w, all_taken w inputs = true ->
  (forall before input rest, inputs = before ++ input :: rest -> holds_at (plays w before) input) ->
  all_ticks tt holds_at w inputs (plays w inputs).
Proof.
  induction inputs as [|input rest rests]; intros w taken all; simpl; [reflexivity|].
  simpl in taken. apply andb_prop in taken as [taken others].
  split; [apply (all [] input rest); reflexivity|].
  exists (after w input), (out_of w input). split.
  - apply after_is_a_tick. unfold truthful. destruct (fate input); auto; discriminate.
  - apply rests; [exact others|]. intros before next last is_so.
    apply (all (input :: before) next last). simpl. rewrite is_so. reflexivity.
Qed.

(** A session that has asked for authority, and follows. *)
Definition to_listening := plays (begun false) [silent].
Definition to_handshake := plays (begun false) [silent; hears [Hello]].
Definition in_obtain := plays (begun false)
  [silent; hears [Hello]; hears [Command 1 ToSubmit 0]; hears [Command 2 ToObtain 20]].
Definition at_10 := after in_obtain silent.
Lemma in_obtain_ran : run tt in_obtain.
Proof. apply plays_is_a_run; [eapply begins, begun_is_started|vm_compute; reflexivity]. Qed.
Lemma to_handshake_ran : run tt to_handshake.
Proof. apply plays_is_a_run; [eapply begins, begun_is_started|vm_compute; reflexivity]. Qed.

(** T1 to T3, T21: an offset moves by its S, and is written. *)
Example covers_T1_T21 : exists w input,
  run tt w /\ one_tick tt w input (after w input) (out_of w input) /\ is_withheld (out_of w input) = false /\
  offsets (axes (server (after w input)) 0%nat) Position - offsets (axes (server w) 0%nat) Position = 10.
Proof.
  exists in_obtain, (hears [Command 3 ToObtain 20]).
  split; [exact in_obtain_ran|]. split; [apply after_is_a_tick; vm_compute; reflexivity|]. split; vm_compute; reflexivity.
Qed.

(** T4: two misses, the first of which a session survives. *)
Example covers_T4 : misses_one tt in_obtain silent /\ misses_one tt at_10 silent /\
  is_running (discrete (server in_obtain)) = true /\ is_running (discrete (server at_10)) = true /\
  misses (discrete (server in_obtain)) = 0%nat /\ skipped (facts tt in_obtain silent) = 0%nat /\
  by_budget (decision tt in_obtain silent) = false /\
  phase (discrete (server (after at_10 silent))) = SafeDisconnect /\
  command (facts tt at_10 (hears [Command 3 ToObtain 20])) <> None.
Proof. vm_compute. repeat split. discriminate. Qed.

(** T5: a ramp that begins away from zero. *)
Definition over_at_20 := plays in_obtain [hears [Command 3 ToObtain 20]; hears [Command 4 ToObtain 20]; silent; silent].
Example covers_T5 : is_over (discrete (server over_at_20)) = true /\
  all_zero (facts tt over_at_20 silent) = false /\
  count (channels (axes (server over_at_20) 0%nat) Position) = 10 /\
  count (channels (axes (server (after over_at_20 silent)) 0%nat) Position) = 0.
Proof. vm_compute. repeat split. Qed.

(** T6, T21: a session is granted. *)
Example covers_T6 : is_live (discrete (settled tt to_listening (hears [Hello]))) = false /\
  is_live (discrete (server (after to_listening (hears [Hello])))) = true.
Proof. vm_compute. split; reflexivity. Qed.

(** T9: a stop at the machine; a server that starts latched. *)
Example covers_T9 : stop (facts tt in_obtain stopped) = true /\
  all_ticks tt (fun _ input => at_rearm (cycle input) = false) (after in_obtain stopped) [silent; silent]
    (plays (after in_obtain stopped) [silent; silent]) /\
  all_ticks tt (fun _ input => at_rearm (cycle input) = true) (begun true) [pressed; pressed]
    (plays (begun true) [pressed; pressed]).
Proof.
  split; [vm_compute; reflexivity|]. split; apply plays_are_ticks; try (vm_compute; reflexivity); intros before input rest is_so.
  - assert (In input [silent; silent]) as one by (rewrite is_so; apply in_or_app; simpl; auto).
    simpl in one. intuition; subst; reflexivity.
  - assert (In input [pressed; pressed]) as one by (rewrite is_so; apply in_or_app; simpl; auto).
    simpl in one. intuition; subst; reflexivity.
Qed.

(** T21: a path that is far away while it is awaited, and when it is a fault. *)
Definition far := {| fate := Taken; events := []; epochs := tt; cycle := {|
  reading := Some (fun _ => (5000, 0)); at_stop := false; at_quit := false; at_rearm := false; elapsed := 1 |} |}.
Example covers_T21 : phase (discrete (server (after in_obtain far))) = Fault /\
  off_path (settled tt in_obtain far) = false /\
  nominal_stepped (nominal_in_force (drives in_obtain 0%nat))
    (nominal_in_force (demanded (server (after in_obtain far)) 0%nat)) tt (cycles (cycle far)) = true.
Proof. vm_compute. repeat split. Qed.

(** T22: silence, from a session that follows and from one that waits for its first command. *)
Example covers_T22 : forall axis k, (axis < N)%nat ->
  largest (limits (axis_config tt axis) k) <= Z.of_nat 2 * rho (limits (axis_config tt axis) k).
Proof. intros. simpl. lia. Qed.
Example silence_of_T22 :
  phase (discrete (server (plays in_obtain [silent; silent; silent; silent]))) = Listening /\
  phase (discrete (server to_handshake)) = Handshake /\
  phase (discrete (server (plays to_handshake [silent; silent; silent]))) = Listening.
Proof. vm_compute. repeat split. Qed.
Example hears_nothing_of_T22 : hears_nothing tt in_obtain silent /\ hears_nothing tt at_10 silent.
Proof. repeat split; vm_compute; auto. Qed.

(** T23: a grant, and a command that acts. *)
Example covers_T23 :
  (epoch (discrete (server to_listening)) < epoch (discrete (server (after to_listening (hears [Hello])))))%nat /\
  action (decision tt in_obtain (hears [Command 3 ToObtain 20])) = Follow.
Proof. split; [simpl; lia|reflexivity]. Qed.

(** T33: a tick of Obtain that counts. *)
Example covers_T33 :
  agitation (axes (server to_listening) 0%nat) = 0 /\
  phase (discrete (server in_obtain)) = Obtain /\
  is_agitated (axes (server in_obtain) 0%nat) (axis_config tt 0) = false.
Proof. vm_compute. repeat split. Qed.

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
  T9_a_stop_is_not_forgotten,
  T9_latch_outlives_the_server,
  T9_a_stuck_rearm_leads_nowhere,
  T21_drives_never_jump,
  T21_unknown_is_not_written,
  T21_path_is_waited_for,
  T21_a_start_waits_for_its_path,
  T22_silence_ends_in_listening,
  T22_handshake_ends_in_listening,
  T23_epochs_never_repeat,
  T33_agitation_is_bounded).
Print Assumptions theorems.
