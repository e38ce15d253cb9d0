"""What the commands run on this machine: the services as local processes, and the actor's fit."""
