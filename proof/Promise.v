(** The promise: if every two robots start at d or farther apart, no two front points are ever nearer
    to each other than d, for any number of robots, whatever is late, lost, frozen, killed or
    restarted. *)

Require Import Reals Lra Psatz Lia.
From Phalanx Require Import Vectors Core Plant Geometry Motion Pair Guard Time.
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

(** E = e^(2 Lambda t) rho never falls, for no two robots. *)
Theorem E_never_falls (I : Type) (S : setting) (robots : I -> robot) :
  assumptions I S robots ->
  forall i j s t, i <> j -> 0 <= s <= t ->
  E_of (rho (d S) (robots i) (robots j)) (2 / lifetime S) s
  <= E_of (rho (d S) (robots i) (robots j)) (2 / lifetime S) t.
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
  assert (Hrest : forall a b, a <> b ->
    keeps_its_share (rate (lifetime S)) (d S) (robots a) (robots b)).
  { intros a b Hab t0 g Ht Hdist Hg.
    apply (share_of_the_slack S (robots a) (robots b) _ t0 g HS (G a)); try assumption.
    - exists b. auto.
    - apply (G b).
    - apply (G b).
    - unfold rho. pose proof (start_apart _ _ _ A a b Hab). lra. }
  replace (2 / lifetime S) with (2 * rate (lifetime S)) by (unfold rate; field; lra).
  apply (two_shares_keep_E_from_falling _ (d S) (v_max S)); try assumption.
  - apply rate_pos. exact HH.
  - apply HS.
  - apply (G i).
  - apply (G j).
  - intros x Hx. apply (proj1 (proj2 (G i)) x Hx).
  - intros x Hx. apply (proj1 (proj2 (G j)) x Hx).
  - apply Hrest. exact Hij.
  - apply Hrest. auto.
  - apply (start_apart _ _ _ A i j Hij).
Qed.

(** The promise of the guard. *)
Theorem no_two_robots_are_ever_nearer_than_d (I : Type) (S : setting) (robots : I -> robot) :
  assumptions I S robots ->
  forall i j t, i <> j -> 0 <= t -> d S <= distance (robots i) (robots j) t.
Proof.
  intros A i j t Hij Ht.
  pose proof (E_never_falls I S robots A i j 0 t Hij ltac:(lra)) as HE.
  apply (E_keeps_the_distance (2 / lifetime S)); [exact HE|exact (start_apart _ _ _ A i j Hij)].
Qed.
