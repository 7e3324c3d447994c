(** The promise: if every two robots start at d or farther apart, no two front points are ever nearer
    to each other than d, for any number of robots, whatever is late, lost, frozen, killed or
    restarted. *)

Require Import Reals Lra Psatz Lia.
From Phalanx Require Import Vectors Core Plant Geometry Motion Guard Time.
Open Scope R_scope.

(** Everything that is assumed, each with what provides it. I is the type of robots' names. *)
Record assumptions (I : Type) (S : setting) (robots : I -> robot) : Prop := Assumptions {

  (** H > 0, v_max >= 0, d > 0, eps >= 0: the scenario's reader refuses others. *)
  constants_make_sense : sensible S;

  (** The pose is the integral of the twist: `unicycle::arc`, called by `World::advance`; see
      [an_arc_moves_like_this]. A physical robot: wheels that do not slip. *)
  robots_move : forall i, moves (robots i);

  (** The wheels do what the command in force says, or a part of it, at v_max at most, and stand from
      the stamp it answers + H on: `World::accept` (scaled), `within_wheel_limits`,
      `within_failing_wheels`, `World::advance` (dies_ns). *)
  wheels_obey : forall i, obeys (lifetime S) (v_max S) (robots i);

  (** Only finitely many messages are taken until any instant, one after the other: calls of
      `World::accept` between calls of `World::advance`. Which are taken, and when, is free. *)
  messages_are_taken_in_turn : forall i, chronological (mail (robots i));

  (** One process of a robot lives at a time; it answers the newest sample and counts its answers:
      `Brain::answer`, and the supervisor, which reaps a process before it starts the next. *)
  one_process_lives : forall i, one_living_incarnation (computed (robots i));

  (** Nobody else sends commands to the robot: the run's own services, in a folder of mode 0700. *)
  nobody_else_commands : forall i, sent_by (computed (robots i)) (mail (robots i));

  (** Samples are taken from t = 0 on: `World::odometry`. *)
  samples_from_the_start : forall i k, 0 <= stamp (computed (robots i) k);

  (** Every command is zero or carries the certificate, computed from positions of the stamp's instant
      that are wrong by at most eps, of all within the sensing radius: `Guard::steer`,
      `Guard::is_blind`, `Guard::grant`, `Guard::collect_sides`, `World::odometry`. *)
  commands_are_certified : forall i k,
    certified S (robots i) (fun o => exists j, j <> i /\ o = robots j) k;

  (** The scenario's start: `phalanx check`. *)
  start_apart : forall i j, i <> j -> d S <= distance (robots i) (robots j) 0
}.

Lemma distance_sym r o t : distance r o t = distance o r t.
Proof. apply norm_minus_sym. Qed.

Lemma distance_changes_at_most (S : setting) r o s t :
  sensible S -> moves r -> moves o ->
  obeys (lifetime S) (v_max S) r -> obeys (lifetime S) (v_max S) o ->
  0 <= s <= t -> Rabs (distance r o t - distance r o s) <= 2 * v_max S * (t - s).
Proof.
  intros [_ [HV _]] Hr Ho Or Oo Hst.
  assert (Mr : norm (minus (front r t) (front r s)) <= v_max S * (t - s)).
  { apply front_moves_at_most; [exact Hr|exact HV|exact Hst|]. intros x Hx. apply (Or x). lra. }
  assert (Mo : norm (minus (front o s) (front o t)) <= v_max S * (t - s)).
  { rewrite norm_minus_sym.
    apply front_moves_at_most; [exact Ho|exact HV|exact Hst|]. intros x Hx. apply (Oo x). lra. }
  set (z := minus (front r t) (front o t)). set (zs := minus (front r s) (front o s)).
  assert (T : norm (minus z zs)
              <= norm (minus (front r t) (front r s)) + norm (minus (front o s) (front o t))).
  { replace (minus z zs)
      with (plus (minus (front r t) (front r s)) (minus (front o s) (front o t)));
      [apply norm_plus|].
    unfold z, zs, plus, minus. simpl. f_equal; ring. }
  pose proof (norm_triangle z zs) as T1. pose proof (norm_triangle zs z) as T2.
  rewrite (norm_minus_sym zs z) in T2.
  unfold distance. fold z. fold zs. apply Rabs_le. lra.
Qed.

Lemma distance_continuous (S : setting) r o :
  sensible S -> moves r -> moves o ->
  obeys (lifetime S) (v_max S) r -> obeys (lifetime S) (v_max S) o ->
  continuous_from_0 (rho S r o).
Proof.
  intros HS Hr Ho Or Oo t Ht e He. pose proof HS as [_ [HV _]].
  exists (e / (2 * v_max S + 1)). split; [apply Rdiv_lt_0_compat; lra|].
  intros s Hs Hst.
  assert (B : 2 * v_max S * Rabs (s - t) < e).
  { assert (X : (2 * v_max S + 1) * Rabs (s - t) < e).
    { replace e with ((2 * v_max S + 1) * (e / (2 * v_max S + 1))) by (field; lra).
      apply Rmult_lt_compat_l; [lra|exact Hst]. }
    pose proof (Rabs_pos (s - t)). lra. }
  unfold rho. replace (distance r o s - d S - (distance r o t - d S))
    with (distance r o s - distance r o t) by ring.
  destruct (Rle_lt_dec t s) as [Hts|Hts].
  - pose proof (distance_changes_at_most S r o t s HS Hr Ho Or Oo ltac:(lra)) as L.
    rewrite Rabs_pos_eq in B by lra. lra.
  - pose proof (distance_changes_at_most S r o s t HS Hr Ho Or Oo ltac:(lra)) as L.
    rewrite Rabs_minus_sym in L. rewrite Rabs_left in B by lra. lra.
Qed.

Lemma running_max_ext (E E' : R -> R) t g :
  (forall x, E x = E' x) -> running_max E t g -> running_max E' t g.
Proof.
  intros HE [Hall [s [Hs Hg]]]. split.
  - intros x Hx. rewrite <- HE. apply Hall. exact Hx.
  - exists s. split; [exact Hs|]. rewrite <- HE. exact Hg.
Qed.

(** Both shares together: the slack falls at most at 2 Lambda e^(-2 Lambda t) g. *)
Lemma slack_falls_at_most (S : setting) (r o : robot) (hears_r hears_o : robot -> Prop) t g :
  sensible S -> guarded S hears_r r -> guarded S hears_o o -> hears_r o -> hears_o r ->
  0 <= rho S r o 0 -> 0 <= t -> 0 < distance r o t ->
  running_max (E_of (rho S r o) (2 * rate (lifetime S))) t g ->
  rises_at (rho S r o) t
    (- (2 * rate (lifetime S)) * exp (- (2 * rate (lifetime S)) * t) * g).
Proof.
  intros HS Hr Ho Hro Hor Hstart Ht Hdist Hg.
  pose proof Hr as [Mr [Or _]]. pose proof Ho as [Mo [Oo _]].
  set (k2 := 2 * rate (lifetime S)) in *.
  assert (Hsym : forall x, rho S r o x = rho S o r x).
  { intros x. unfold rho. rewrite distance_sym. reflexivity. }
  pose proof (share_of_the_slack S r o hears_r t g HS Hr Hro Mo Oo Hstart Ht Hdist Hg) as Br.
  assert (Bo : - (rate (lifetime S) * exp (- k2 * t) * g)
               <= dot (direction o r t) (front_velocity o t)).
  { apply (share_of_the_slack S o r hears_o t g HS Ho Hor Mr Or); try assumption.
    - rewrite <- Hsym. exact Hstart.
    - rewrite distance_sym. exact Hdist.
    - apply (running_max_ext (E_of (rho S r o) k2)); [|exact Hg].
      intros x. unfold E_of. rewrite Hsym. reflexivity. }
  set (n := direction r o t) in *.
  assert (Hn : direction o r t = scale (-1) n).
  { unfold n, direction. rewrite (distance_sym o r). unfold scale, minus. simpl. f_equal; ring. }
  rewrite Hn, scale_dot in Bo.
  assert (Hunit : norm n = 1).
  { unfold n, direction. rewrite norm_scale by (left; apply Rinv_0_lt_compat; exact Hdist).
    unfold distance. field. unfold distance in Hdist. lra. }
  (* Along the direction n as it was at t, the distance is no larger than in truth. *)
  set (f := fun x => 1 * (fst n * fst (front r x) + snd n * snd (front r x))
                     + -1 * (fst n * fst (front o x) + snd n * snd (front o x))).
  assert (Hf : forall x, f x = dot n (minus (front r x) (front o x))).
  { intros x. unfold f, dot, minus. simpl. ring. }
  assert (Hbelow : forall x, f x <= distance r o x).
  { intros x. rewrite Hf. pose proof (dot_le_norms n (minus (front r x) (front o x))) as B.
    rewrite Hunit in B. unfold distance. lra. }
  assert (Hequal : f t = distance r o t).
  { rewrite Hf. unfold n, direction. rewrite scale_dot, <- norm_sq. fold (distance r o t).
    field. lra. }
  destruct Mr as [_ [_ [_ [_ Dr]]]]. destruct Mo as [_ [_ [_ [_ Do]]]].
  destruct (Dr t Ht) as [_ [Drx Dry]]. destruct (Do t Ht) as [_ [Dox Doy]].
  assert (Hrise : rises_at f t (- k2 * exp (- k2 * t) * g)).
  { apply rises_of_right_derivative with
      (1 * (fst n * fst (front_velocity r t) + snd n * snd (front_velocity r t))
       + -1 * (fst n * fst (front_velocity o t) + snd n * snd (front_velocity o t))).
    - apply (right_derivative_combination
               (fun x => fst n * fst (front r x) + snd n * snd (front r x))
               (fun x => fst n * fst (front o x) + snd n * snd (front o x)));
        apply right_derivative_combination; assumption.
    - unfold dot in Br, Bo. unfold k2 in *. lra. }
  intros e He. destruct (Hrise e He) as [del [Hdel Hstep]].
  exists del. split; [exact Hdel|]. intros h Hh. specialize (Hstep h Hh).
  specialize (Hbelow (t + h)). unfold rho. rewrite Hequal in Hstep. lra.
Qed.

(** E = e^(2 Lambda t) rho never falls, for no two robots. *)
Theorem E_never_falls (I : Type) (S : setting) (robots : I -> robot) :
  assumptions I S robots ->
  forall i j s t, i <> j -> 0 <= s <= t ->
  E_of (rho S (robots i) (robots j)) (2 / lifetime S) s
  <= E_of (rho S (robots i) (robots j)) (2 / lifetime S) t.
Proof.
  intros A i j s t Hij Hst.
  pose proof (constants_make_sense _ _ _ A) as HS. pose proof HS as [HH [_ [Hd _]]].
  assert (G : forall i, guarded S (fun o => exists j, j <> i /\ o = robots j) (robots i)).
  { intros k. unfold guarded.
    split; [apply (robots_move _ _ _ A)|]. split; [apply (wheels_obey _ _ _ A)|].
    split; [apply (messages_are_taken_in_turn _ _ _ A)|].
    split; [apply (one_process_lives _ _ _ A)|]. split; [apply (nobody_else_commands _ _ _ A)|].
    intros m. split; [apply (samples_from_the_start _ _ _ A)|].
    apply (commands_are_certified _ _ _ A). }
  assert (Hstart : 0 <= rho S (robots i) (robots j) 0).
  { unfold rho. pose proof (start_apart _ _ _ A i j Hij). lra. }
  replace (2 / lifetime S) with (2 * rate (lifetime S)) by (unfold rate; field; lra).
  pose proof (rate_pos (lifetime S) HH) as HL.
  apply (core_slack _ _ (d S)); [lra|exact Hd|exact Hstart| | |exact Hst].
  - apply distance_continuous; try apply (G _); exact HS.
  - intros u g Hu Hg Hhigh.
    apply (slack_falls_at_most S (robots i) (robots j) _ _ u g HS (G i) (G j));
      try assumption.
    + exists j. auto.
    + exists i. auto.
    + unfold rho in Hhigh. lra.
Qed.

(** The promise of the guard. *)
Theorem no_two_robots_are_ever_nearer_than_d (I : Type) (S : setting) (robots : I -> robot) :
  assumptions I S robots ->
  forall i j t, i <> j -> 0 <= t -> d S <= distance (robots i) (robots j) t.
Proof.
  intros A i j t Hij Ht.
  pose proof (E_never_falls I S robots A i j 0 t Hij ltac:(lra)) as HE.
  pose proof (start_apart _ _ _ A i j Hij) as H0.
  unfold E_of in HE. rewrite Rmult_0_r, exp_0, Rmult_1_l in HE. unfold rho in HE.
  pose proof (exp_pos (2 / lifetime S * t)) as P.
  destruct (Rle_lt_dec (d S) (distance (robots i) (robots j) t)) as [|Hlt]; [assumption|exfalso].
  assert (exp (2 / lifetime S * t) * (distance (robots i) (robots j) t - d S) < 0) by nra.
  lra.
Qed.
