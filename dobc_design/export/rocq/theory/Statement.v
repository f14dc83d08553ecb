(* The closed loop as the paper prints it, and the claim about it: what a reader has to trust.

   Agents, components and states of the exosystems are numbered from 0. R are the real numbers, and nat -> R is a function
   of one number: a vector; nat -> nat -> R is a matrix (row, column), nat -> nat -> nat -> R one matrix for each agent, and
   R -> R a function of time or of a difference of two states. Values at numbers that are too large (agent n, component m) play
   no part, as long as arcs come from agents below n. [f a b] is f(a, b); Rabs is the absolute value; <= and < of natural numbers end in %nat. *)
Require Import Reals List.
Import ListNotations.
Open Scope R_scope.

(* f(0) + f(1) + ... + f(k - 1); 0 for k = 0. *)
Fixpoint sum (k : nat) (f : nat -> R) : R := match k with O => 0 | S i => sum i f + f i end.

(* f has the derivative l from the right at t: (f(s) - f(t)) / (s - t) tends to l as s > t tends to t. *)
Definition right_derivative (f : R -> R) (t l : R) : Prop :=
  forall eps, 0 < eps -> exists d, 0 < d /\ forall s, t < s < t + d -> Rabs ((f s - f t) / (s - t) - l) <= eps.

(* f' = g on [0, T): f is continuous, and its derivative from the right is g(t), also where a switch makes g jump. At a switch
   g(t) is the value after it. Nothing is said about t < 0. *)
Definition evolves {T : R} (f g : R -> R) : Prop :=
  (forall t, 0 <= t < T -> right_derivative f t (g t)) /\ (forall t, 0 < t < T -> continuity_pt f t).

(* An arc: agent [listener] uses the state of agent [speaker], through the coupling function h_ij; the weight of the arc is
   part of it. The paper's arc (i, j) is [Arc i j h]. *)
Record arc := Arc { listener : nat; speaker : nat; coupling : R -> R }.

Record loop := Loop {
  agents : nat; components : nat; modes : nat;  (* n, m and the number of graphs *)
  arcs : nat -> list arc;                 (* the graph of each mode; an arc that is listed twice counts twice *)
  gain : nat -> nat -> nat -> R;          (* K_i, m x m; 0 for an agent without a pin *)
  target : nat -> R;                      (* xbar, by component *)
  offset : nat -> nat -> R;               (* of agent i in the formation, by component; 0 without one *)
  order : nat -> nat;                     (* q, of the exosystem of agent i; 0 without a disturbance *)
  A : nat -> nat -> nat -> R;             (* of agent i, q x q *)
  C : nat -> nat -> nat -> R;             (* of agent i, m x q *)
  W : nat -> nat -> nat -> R              (* observer gain of agent i, q x m *)
}.

Section Motion.
Variable l : loop.
Variable T : R.                                   (* the motion is given on [0, T) *)
Variable mode : R -> nat.                         (* which graph is on at time t *)
Variables x xi z : nat -> nat -> R -> R.          (* states of agents, exosystems and observers: agent, component, time *)

(* The sum of the couplings in (1), component c: over all arcs of the present graph whose listener is i. [fold_right Rplus 0]
   adds a list up. The coupling sees the difference of the two states, each less the offset of its agent. *)
Definition heard (i c : nat) (t : R) : R :=
  fold_right Rplus 0 (map (fun a =>
    if Nat.eqb (listener a) i
    then coupling a ((x (speaker a) c t - offset l (speaker a) c) - (x i c t - offset l i c))
    else 0) (arcs l (mode t))).

(* e_i (14): the state less the goal of the agent, xbar + offset_i. *)
Definition error (i c : nat) (t : R) : R := x i c t - (target l c + offset l i c).
Definition disturbance (i c : nat) (t : R) : R := sum (order l i) (fun k => C l i c k * xi i k t).            (* d_i (12) *)
Definition estimate (i k : nat) (t : R) : R := z i k t + sum (components l) (fun c => W l i k c * x i c t).  (* xihat_i (13) *)
Definition control (i c : nat) (t : R) : R :=                                                               (* u_i (19) *)
  - sum (components l) (fun d => gain l i c d * error i d t) - sum (order l i) (fun k => C l i c k * estimate i k t).

(* x, xi and z are a motion of the loop on [0, T): for each agent
     x_i'  = heard_i + u_i + d_i,   xi_i' = A xi_i,   z_i' = (A - W C) xihat_i - W (heard_i + u_i). *)
Definition closed_loop : Prop := forall i, (i < agents l)%nat ->
  (forall c, (c < components l)%nat ->                                                                       (* (1) *)
     evolves (T := T) (x i c) (fun t => heard i c t + control i c t + disturbance i c t)) /\
  (forall k, (k < order l i)%nat ->                                                                          (* (12) *)
     evolves (T := T) (xi i k) (fun t => sum (order l i) (fun j => A l i k j * xi i j t))) /\
  (forall k, (k < order l i)%nat ->                                                                          (* (13) *)
     evolves (T := T) (z i k) (fun t =>
       sum (order l i) (fun j => (A l i k j - sum (components l) (fun c => W l i k c * C l i c j)) * estimate i j t)
       - sum (components l) (fun c => W l i k c * (heard i c t + control i c t)))).

End Motion.

(* Every motion of the loop, under any switching, that starts with |x_i - goal_i| <= radius in each component and with
   |xi_i - xihat_i| <= off (Euclidean norm) for each agent, has |x_i(t) - goal_i| <= bound_i exp(-rate t) in each
   component for as long as it lasts: on [0, T), whatever T is.

   A motion for all t >= 0 is one on [0, T) for every T; and a solution that grows without bound before some time T is
   one on [0, T), so that there is none. Any switching: [mode] may be any function of time for which there is a motion.
   Signals that are constant between switches, with the new graph on from the switch on, are meant; switches may
   accumulate before a time, but not after it. *)
Definition converges (l : loop) (radius off : R) (bound : nat -> R) (rate : R) : Prop :=
  forall T mode x xi z,
    (forall t, 0 <= t < T -> (mode t < modes l)%nat) ->
    closed_loop l T mode x xi z ->
    (forall i c, (i < agents l)%nat -> (c < components l)%nat -> Rabs (error l x i c 0) <= radius) ->
    (forall i, (i < agents l)%nat -> sum (order l i) (fun k => (xi i k 0 - estimate l x z i k 0) ^ 2) <= off ^ 2) ->
  forall t i c, 0 <= t < T -> (i < agents l)%nat -> (c < components l)%nat ->
    Rabs (error l x i c t) <= bound i * exp (- (rate * t)).
