(* The closed loop as the paper prints it: what a reader has to trust. *)
Require Import Reals List.
Import ListNotations.
Open Scope R_scope.

Fixpoint sum (k : nat) (f : nat -> R) : R := match k with O => 0 | S i => sum i f + f i end.

(* f has the derivative l from the right at t. *)
Definition right_derivative (f : R -> R) (t l : R) : Prop :=
  forall eps, 0 < eps -> exists d, 0 < d /\ forall s, t < s < t + d -> Rabs ((f s - f t) / (s - t) - l) <= eps.

(* f' = g for all t >= 0: f is continuous, and its derivative from the right is g(t), also where a switch makes g jump. *)
Definition evolves (f g : R -> R) : Prop :=
  (forall t, 0 <= t -> right_derivative f t (g t)) /\ (forall t, 0 < t -> continuity_pt f t).

(* Agent [listener] hears agent [speaker] through the coupling function; the weight of the arc is part of it. *)
Record arc := Arc { listener : nat; speaker : nat; coupling : R -> R }.

Record loop := Loop {
  agents : nat; components : nat; modes : nat;  (* n, m and the number of graphs *)
  arcs : nat -> list arc;                 (* the graph of each mode *)
  gain : nat -> nat -> nat -> R;          (* K_i, m x m; 0 for an agent without a pin *)
  target : nat -> R;                      (* xbar *)
  offset : nat -> nat -> R;               (* of agent i in the formation; 0 without one *)
  order : nat -> nat;                     (* q, of the exosystem of agent i; 0 without a disturbance *)
  A : nat -> nat -> nat -> R;             (* of agent i, q x q *)
  C : nat -> nat -> nat -> R;             (* of agent i, m x q *)
  W : nat -> nat -> nat -> R              (* observer gain of agent i, q x m *)
}.

Section Motion.
Variable l : loop.
Variable mode : R -> nat.                         (* which graph is on at time t *)
Variables x xi z : nat -> nat -> R -> R.          (* states, exosystems, observers: agent, component, time *)

Definition heard (i c : nat) (t : R) : R :=
  fold_right Rplus 0 (map (fun a =>
    if Nat.eqb (listener a) i
    then coupling a ((x (speaker a) c t - offset l (speaker a) c) - (x i c t - offset l i c))
    else 0) (arcs l (mode t))).

Definition error (i c : nat) (t : R) : R := x i c t - (target l c + offset l i c).
Definition disturbance (i c : nat) (t : R) : R := sum (order l i) (fun k => C l i c k * xi i k t).            (* d_i (12) *)
Definition estimate (i k : nat) (t : R) : R := z i k t + sum (components l) (fun c => W l i k c * x i c t).  (* xihat_i (13) *)
Definition control (i c : nat) (t : R) : R :=                                                               (* u_i (19) *)
  - sum (components l) (fun d => gain l i c d * error i d t) - sum (order l i) (fun k => C l i c k * estimate i k t).

Definition closed_loop : Prop := forall i, (i < agents l)%nat ->
  (forall c, (c < components l)%nat ->                                                                       (* (1) *)
     evolves (x i c) (fun t => heard i c t + control i c t + disturbance i c t)) /\
  (forall k, (k < order l i)%nat ->                                                                          (* (12) *)
     evolves (xi i k) (fun t => sum (order l i) (fun j => A l i k j * xi i j t))) /\
  (forall k, (k < order l i)%nat ->                                                                          (* (13) *)
     evolves (z i k) (fun t =>
       sum (order l i) (fun j => (A l i k j - sum (components l) (fun c => W l i k c * C l i c j)) * estimate i j t)
       - sum (components l) (fun c => W l i k c * (heard i c t + control i c t)))).

End Motion.

(* Every motion of the loop, under any switching, that starts with |x_i - goal_i| <= radius in each component and
   with estimates of the exosystem that are off by at most [off] (Euclidean), obeys the bound for all time. *)
Definition converges (l : loop) (radius off : R) (bound : nat -> R) (rate : R) : Prop :=
  forall mode x xi z,
    (forall t, 0 <= t -> (mode t < modes l)%nat) ->
    closed_loop l mode x xi z ->
    (forall i c, (i < agents l)%nat -> (c < components l)%nat -> Rabs (error l x i c 0) <= radius) ->
    (forall i, (i < agents l)%nat -> sum (order l i) (fun k => (xi i k 0 - estimate l x z i k 0) ^ 2) <= off ^ 2) ->
  forall t i c, 0 <= t -> (i < agents l)%nat -> (c < components l)%nat ->
    Rabs (error l x i c t) <= bound i * exp (- (rate * t)).
